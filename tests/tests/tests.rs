//! Integration tests; one line a theme.
