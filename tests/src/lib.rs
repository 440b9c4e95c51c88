//! Integration tests, benchmark and peer drivers of lodpack.
