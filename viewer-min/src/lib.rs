//! A minimal viewer of lodpack files: a window, pictures without one, and checks of the drawing.
//!
//! [`scene::Scene`] follows a camera through the sessions of its [`surface::Surface`]s, which decide what to draw; a
//! renderer draws it in one of two ways; [`check`] compares the pictures with each other and with the original mesh.
#![allow(clippy::disallowed_methods, reason = "cameras and pictures; no file depends on them")]
#![forbid(unsafe_code)]

pub mod args;
mod blocks;
pub mod camera;
mod channel;
pub mod check;
mod controls;
mod devices;
mod draw;
mod frames;
pub mod gpu;
mod headless;
mod kept;
mod objects;
mod overlay;
pub mod picture;
mod pool;
mod present;
pub mod report;
mod root_data;
pub mod scene;
mod shot;
pub mod surface;
mod texels;
mod wall;
mod window;

pub use headless::{draw_picture, draw_tiles};
pub use wall::{control_wall, join_wall};
pub use window::show_window;
