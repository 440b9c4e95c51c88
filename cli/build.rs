//! Makes the viewer page part of the program, with the reader that `reader/wasm/build` has packed; `lodpack serve`
//! shows it. Where the repository is not around the program it builds just the same, and `lodpack serve --page` takes
//! the page from a folder.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo says it"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo says it"));
    let (page, package) = (here.join("../viewer-min/web"), here.join("../reader/wasm"));
    let wasm = package.join("lodpack.wasm.gz");
    let mut list = String::from("/// Paths and bytes of the viewer page.\nconst EMBEDDED: &[(&str, &[u8])] = &[\n");
    if wasm.is_file() {
        let scripts = package.join("js");
        for (folder, prefix) in [(&page, ""), (&scripts, "/lodpack/js")] {
            watch(folder);
            for file in files(folder) {
                add(&mut list, &format!("{prefix}/{}", file.file_name().unwrap_or_default().to_string_lossy()), &file);
            }
        }
        add(&mut list, "/lodpack/lodpack.wasm.gz", &wasm);
    } else {
        println!("cargo::rerun-if-changed=build.rs");
    }
    fs::write(out.join("page.rs"), list + "];\n").expect("cargo's folder can be written");
}

/// The page's files in a folder, in one order everywhere.
fn files(folder: &Path) -> Vec<PathBuf> {
    let is_page = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "js" || ending == "html");
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_page).collect();
    files.sort();
    files
}

fn add(list: &mut String, path: &str, file: &Path) {
    watch(file);
    let file = fs::canonicalize(file).expect("it was listed");
    writeln!(list, "    ({path:?}, include_bytes!({:?})),", file.to_string_lossy()).expect("text can be written to");
}

fn watch(path: &Path) {
    println!("cargo::rerun-if-changed={}", path.display());
}
