"""A decoder of lodpack files, written from SPEC.md alone: a module a chapter. See ../decode.py."""
