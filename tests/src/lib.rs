//! Integration tests, benchmark and peer drivers of lodpack.
#![allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter")]

pub mod boxes;
pub mod city;
pub mod corpus;
pub mod dump;
pub mod extremes;
pub mod generate;
pub mod handmade;
pub mod hiding;
pub mod id_picture;
pub mod nginx;
pub mod parts;
pub mod raster;
pub mod rays;
pub mod scene;
pub mod server;
pub mod strips;
pub mod terrain;
pub mod tiff;
