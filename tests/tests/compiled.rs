//! The crates that each program compiles: the budgets of tests/RESULTS.md, "What is compiled", and the licences and
//! sources that deny.toml allows.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The output of cargo; none, with the reason on stderr, if it cannot answer without a network.
fn cargo(args: &[&str]) -> Option<String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let out = Command::new(cargo)
        .args(args)
        .args(["--offline", "--locked"])
        .current_dir(root())
        .output()
        .map_err(|error| eprintln!("skipped {args:?}: cargo does not run: {error}"))
        .ok()?;
    let said = String::from_utf8_lossy(&out.stderr);
    if !out.status.success() {
        // A stale lock file is not a reason to skip.
        assert!(!said.contains("--locked was passed"), "{said}");
        eprintln!("skipped {args:?}: cargo needs a network (`cargo fetch --locked` first): {said}");
        return None;
    }
    Some(String::from_utf8_lossy(&out.stdout).into_owned())
}

/// The names of the crates that `cargo tree` lists for these arguments.
fn crates(args: &[&str]) -> Option<BTreeSet<String>> {
    let listed = cargo(&[&["tree", "--edges", "normal", "--prefix", "none"], args].concat())?;
    // Two versions of a crate count as two crates. A crate listed before is marked with a star.
    let line = |line: &str| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    Some(listed.lines().map(line).filter(|line| !line.is_empty()).collect())
}

#[test]
fn no_program_compiles_more_crates_than_its_budget() {
    let local = ["-p", "lodpack", "--no-default-features", "--features", "file,threads"];
    for (args, budget) in [
        (&local[..3], 25),
        (&local[..], 25),
        (&["-p", "lodpack", "--features", "http"], 40),
        (&["-p", "lodpack", "--features", "object-store"], 180),
        // Completions, man pages and help as wide as the terminal take five, the web server of `serve` ten.
        (&["-p", "lodpack-cli"], 190),
        (&["-p", "lodpack-view"], 180),
    ] {
        let Some(crates) = crates(args) else { continue };
        println!("{} crates: {args:?}", crates.len());
        assert!(crates.len() > 3 && crates.len() <= budget, "{} crates for {args:?}: {crates:#?}", crates.len());
    }
}

#[test]
fn programs_that_read_local_files_compile_no_http_no_tls_and_no_image_codec() {
    const UNNEEDED: [&str; 16] = [
        "ureq",
        "http",
        "httparse",
        "hyper",
        "reqwest",
        "rustls",
        "ring",
        "native-tls",
        "openssl",
        "webpki-roots",
        "tokio",
        "object_store",
        "image",
        "png",
        "exr",
        "zune-jpeg",
    ];
    let found = |args: &[&str]| -> Option<Vec<&str>> {
        let crates = crates(args)?;
        let has =
            |name: &&&str| crates.iter().any(|line| line.split_once(' ').is_some_and(|(found, _)| found == **name));
        Some(UNNEEDED.iter().filter(has).copied().collect())
    };
    for features in ["", "file", "file,threads,mmap,serde"] {
        let args = ["-p", "lodpack", "--no-default-features", "--features", features];
        assert!(found(&args).unwrap_or_default().is_empty(), "{features}: {:?}", found(&args));
    }
    assert!(found(&["-p", "lodpack"]).unwrap_or_default().is_empty());
    // Ensures that the list can find something.
    for (args, name) in
        [(["-p", "lodpack", "--features", "http"].as_slice(), "rustls"), (&["-p", "lodpack-cli"], "png")]
    {
        assert!(found(args).is_none_or(|found| found.contains(&name)), "{name} is not in {args:?}");
    }
}

/// Whether a licence expression (SPDX) can be met by licences that are allowed.
fn is_met(expression: &str, allowed: &dyn Fn(&str) -> bool) -> bool {
    /// Splits at a word that stands outside of parentheses.
    fn split<'a>(words: &[&'a str], at: &str) -> Vec<Vec<&'a str>> {
        let (mut depth, mut terms) = (0, vec![vec![]]);
        for &word in words {
            depth += i32::from(word == "(") - i32::from(word == ")");
            match terms.last_mut() {
                Some(term) if word != at || depth > 0 => term.push(word),
                _ => terms.push(vec![]),
            }
        }
        terms
    }
    fn any(words: &[&str], allowed: &dyn Fn(&str) -> bool) -> bool {
        split(words, "OR").iter().any(|term| split(term, "AND").iter().all(|factor| one(factor, allowed)))
    }
    fn one(words: &[&str], allowed: &dyn Fn(&str) -> bool) -> bool {
        match words {
            ["(", inside @ .., ")"] => any(inside, allowed),
            words => allowed(&words.join(" ")),
        }
    }
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    any(&spaced.split_whitespace().collect::<Vec<_>>(), allowed)
}

#[test]
fn licences_are_met_by_one_side_of_or_and_both_sides_of_and() {
    let allowed = |name: &str| ["MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"].contains(&name);
    for expression in
        ["MIT", "GPL-3.0 OR MIT", "GPL-3.0/MIT", "(GPL-3.0 OR MIT) AND Zlib", "Apache-2.0 WITH LLVM-exception"]
    {
        assert!(is_met(expression, &allowed), "{expression}");
    }
    for expression in
        ["", "GPL-3.0", "Apache-2.0", "GPL-3.0 AND MIT", "MIT AND (GPL-3.0 OR Apache-2.0)", "(MIT OR Zlib) AND GPL-3.0"]
    {
        assert!(!is_met(expression, &allowed), "{expression}");
    }
}

#[test]
fn licences_and_sources_of_all_crates_are_those_that_deny_toml_allows() {
    const CRATES_IO: &str = "registry+https://github.com/rust-lang/crates.io-index";
    let rules = std::fs::read_to_string(root().join("deny.toml")).expect("deny.toml is there");
    // Lists of quoted words, one per line.
    let quoted = |line: &str| line.split('"').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let list = |start: &str| rules.lines().find(|line| line.starts_with(start)).map(quoted).unwrap_or_default();
    let (allowed, exceptions) = (list("allow = "), list("exceptions = "));
    assert!(allowed.len() > 2 && exceptions.len() == 2, "deny.toml has an unexpected layout: {rules}");

    let version = Command::new("rustc").arg("-vV").output().expect("rustc runs");
    let version = String::from_utf8_lossy(&version.stdout).into_owned();
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc has a host");
    let Some(metadata) = cargo(&["metadata", "--format-version", "1", "--filter-platform", host]) else { return };
    let metadata: Value = serde_json::from_str(&metadata).expect("cargo prints JSON");
    let packages = metadata["packages"].as_array().expect("there are packages");
    assert!(packages.len() > 100);
    for package in packages {
        let [name, licence] = ["name", "license"].map(|key| package[key].as_str().unwrap_or_default());
        let is_allowed = |licence: &str| {
            let is_exception = exceptions[0] == name && exceptions[1] == licence;
            is_exception || allowed.iter().any(|allowed| allowed == licence)
        };
        assert!(is_met(licence, &is_allowed), "{name} is under {licence:?}, which deny.toml does not allow");
        // Packages of the workspace have no source.
        let source = package["source"].as_str();
        assert!(source.is_none_or(|source| source == CRATES_IO), "{name} is from {source:?}, not from crates.io");
    }
}
