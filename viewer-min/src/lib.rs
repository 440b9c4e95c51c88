//! A minimal viewer of lodpack files: a window, pictures without one, and checks of what is drawn.
//!
//! [`scene::Scene`] follows a camera through the reader's session and says what is to be drawn; [`draw::Renderer`] draws it in
//! one of two ways; [`check`] compares the pictures with each other and with the original mesh.
#![forbid(unsafe_code)]

pub mod args;
pub mod blocks;
pub mod camera;
pub mod check;
pub mod controls;
pub mod draw;
pub mod gpu;
pub mod headless;
pub mod overlay;
pub mod picture;
pub mod pipelines;
pub mod present;
pub mod scene;
pub mod source;
pub mod window;
