//! What is compiled: the budgets of README's section "What is compiled", by `cargo tree`.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// The names of the crates that `cargo tree` lists for these arguments; none, with the reason on stderr, where it cannot list
/// them without a network.
fn crates(args: &[&str]) -> Option<BTreeSet<String>> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let fixed = ["tree", "--edges", "normal", "--prefix", "none", "--offline", "--locked"];
    let out = Command::new(cargo)
        .args(fixed)
        .args(args)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .output()
        .map_err(|error| eprintln!("skipped {args:?}: cargo does not run: {error}"))
        .ok()?;
    let said = String::from_utf8_lossy(&out.stderr);
    if !out.status.success() {
        // A lock file that does not fit is no reason to skip.
        assert!(!said.contains("--locked was passed"), "{said}");
        eprintln!("skipped {args:?}: cargo needs a network (`cargo fetch --locked` first): {said}");
        return None;
    }
    // Two versions of a crate are two crates; a crate that was listed before has a star.
    let line = |line: &str| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    Some(String::from_utf8_lossy(&out.stdout).lines().map(line).filter(|line| !line.is_empty()).collect())
}

#[test]
fn no_program_compiles_more_crates_than_its_budget() {
    let local = ["-p", "lodpack", "--no-default-features", "--features", "file,threads"];
    for (args, budget) in [
        (&local[..3], 25),
        (&local[..], 25),
        (&["-p", "lodpack", "--features", "http"], 40),
        (&["-p", "lodpack", "--features", "object-store"], 180),
        // Completions, man pages and help as wide as the terminal take five.
        (&["-p", "lodpack-cli"], 165),
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
    // So that the list can find something.
    for (args, name) in
        [(["-p", "lodpack", "--features", "http"].as_slice(), "rustls"), (&["-p", "lodpack-cli"], "png")]
    {
        assert!(found(args).is_none_or(|found| found.contains(&name)), "{name} is not in {args:?}");
    }
}
