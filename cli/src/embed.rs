//! Stub: embed.
