//! Opens addresses in the browser that people have chosen.

use crate::messages;
use std::process::{Command, Stdio};

/// Opens an address, and says so if that is not possible.
pub fn open(address: &str) {
    let (program, arguments): (_, &[&str]) = if cfg!(target_os = "macos") {
        ("open", &[])
    } else if cfg!(windows) {
        // `start` is a word of the shell, and takes a first text in quotes for a title.
        ("cmd", &["/C", "start", ""])
    } else {
        ("xdg-open", &[])
    };
    let mut command = Command::new(program);
    command.args(arguments).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let address = address.to_owned();
    let cannot = move |why: String| {
        messages::tell("note", &format!("{program} cannot open a browser ({why}); open {address} in one"))
    };
    match command.spawn() {
        Err(error) => cannot(error.to_string()),
        Ok(mut started) => {
            // It may run as long as the browser does.
            std::thread::spawn(move || match started.wait() {
                Ok(status) if !status.success() => cannot(status.to_string()),
                _ => {}
            });
        }
    }
}
