//! The house in order: rooms that import in one direction, a crate's face that can be surveyed, documents that point to
//! what is there, a front door of one page.

use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Runs a script of `tests/`; whether it is content, and everything that it printed.
fn script(name: &str, args: &[&str]) -> (bool, String) {
    let run = Command::new("python3").arg(root().join("tests").join(name)).args(args).output();
    let run = run.expect("python3 runs");
    (run.status.success(), String::from_utf8_lossy(&[run.stdout, run.stderr].concat()).into_owned())
}

/// Copies what the scripts read of the repository.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a writable temporary directory");
    for entry in std::fs::read_dir(from).expect("a readable folder") {
        let path = entry.expect("a readable folder").path();
        let target = to.join(path.file_name().expect("entries have names"));
        if path.is_dir() {
            copy(&path, &target);
        } else {
            std::fs::copy(&path, &target).expect("a readable file");
        }
    }
}

/// A copy of the sources and of ARCHITECTURE.md.
fn house() -> tempfile::TempDir {
    let house = tempfile::tempdir().expect("a temporary directory");
    let builder = ["cli/builder/src", "cli/stage/src", "cli/import/src", "cli/mesh/src", "cli/runtime/src"];
    for sources in ["reader/src", "cli/src", "viewer-min/src"].iter().chain(&builder) {
        copy(&root().join(sources), &house.path().join(sources));
    }
    std::fs::copy(root().join("ARCHITECTURE.md"), house.path().join("ARCHITECTURE.md")).expect("it is there");
    house
}

fn append(path: &Path, text: &str) {
    let old = std::fs::read_to_string(path).expect("a readable file");
    std::fs::write(path, old + text).expect("a writable file");
}

#[test]
fn rooms_import_in_one_direction_and_the_picture_shows_them() {
    let (content, said) = script("rooms.py", &[]);
    assert!(content, "{said}");
}

#[test]
fn an_arrow_that_points_upward_is_named_with_its_place() {
    let house = house();
    let args = ["--root", house.path().to_str().expect("a readable path")];
    let (content, said) = script("rooms.py", &args);
    assert!(content, "{said}");
    append(&house.path().join("reader/src/source/mod.rs"), "\nuse {crate::limits::Limits, super::stream::Session};\n");
    let (content, said) = script("rooms.py", &args);
    assert!(!content && said.contains("reader/src/source/mod.rs:"), "{said}");
    assert!(said.contains("source uses stream"), "{said}");
}

#[test]
fn an_arrow_in_code_counts_and_one_in_a_test_or_a_comment_does_not() {
    let house = house();
    let args = ["--root", house.path().to_str().expect("a readable path")];
    let file = house.path().join("cli/builder/src/region/mod.rs");
    append(&file, "\n// crate::job::Job\n#[cfg(test)]\nmod more {\n    use crate::job::Job;\n}\n");
    let (content, said) = script("rooms.py", &args);
    assert!(content, "{said}");
    append(&file, "\nfn upward() -> &'static str {\n    crate::job::name(\"crate::measure\")\n}\n");
    let (content, said) = script("rooms.py", &args);
    assert!(!content && said.contains("region uses job") && !said.contains("measure"), "{said}");
}

#[test]
fn files_of_a_room_that_lead_back_to_one_another_are_named() {
    let house = house();
    let args = ["--root", house.path().to_str().expect("a readable path")];
    append(&house.path().join("cli/builder/src/reduce/spread_points.rs"), "\nuse super::ways::Topology;\n");
    let (content, said) = script("rooms.py", &args);
    assert!(!content && said.contains("cli/builder/src/reduce: ") && said.contains("spread_points ways"), "{said}");
    // What the first page of the room shows leads to no file.
    let house = self::house();
    append(&house.path().join("cli/builder/src/reduce/spread_points.rs"), "\nuse super::Topology;\n");
    let (content, said) = script("rooms.py", &["--root", house.path().to_str().expect("a readable path")]);
    assert!(content, "{said}");
}

#[test]
fn a_picture_that_is_not_of_today_is_refused_and_drawn_anew() {
    let house = house();
    let args = ["--root", house.path().to_str().expect("a readable path")];
    let file = house.path().join("ARCHITECTURE.md");
    let today = std::fs::read_to_string(&file).expect("it was copied");
    std::fs::write(&file, today.replacen("    stream --> ", "    stream --> limits & ", 1)).expect("a writable file");
    let (content, said) = script("rooms.py", &args);
    assert!(!content && said.contains("--write"), "{said}");
    assert!(script("rooms.py", &[args[0], args[1], "--write"]).0);
    assert_eq!(std::fs::read_to_string(&file).expect("it was written"), today);
}

#[test]
fn a_crate_with_too_many_names_at_its_root_is_refused() {
    let house = house();
    let names: Vec<String> = (0..40).map(|number| format!("Name{number}")).collect();
    append(
        &house.path().join("reader/src/lib.rs"),
        &format!("\npub use select::{{{}}};\npub fn open() {{}}\n", names.join(", ")),
    );
    let (content, said) = script("rooms.py", &["--root", house.path().to_str().expect("a readable path")]);
    assert!(!content && said.contains("lib.rs shows") && said.contains("Name39, "), "{said}");
}

#[test]
fn every_link_anchor_and_path_of_the_documents_leads_somewhere() {
    let (content, said) = script("links.py", &[]);
    assert!(content, "{said}");
}

#[test]
fn a_link_that_leads_nowhere_is_named_with_its_line() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let args = ["--root", folder.path().to_str().expect("a readable path")];
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("a writable file");
    write("there.md", "# One and *two*\n\n```\n[not a link](nowhere.md)\n```\n");
    write("links.md", "[a](there.md) [b](there.md#one-and-two) [c](https://example.org/) `there.md`\n");
    let (content, said) = script("links.py", &args);
    assert!(content, "{said}");
    write("links.md", "\n[a](gone.md)\n[b](there.md#three)\n`src/gone.rs`\n");
    write("code.rs", "//! See HEARSAY.md.\n");
    let (content, said) = script("links.py", &args);
    assert!(!content, "{said}");
    for problem in ["links.md:2", "links.md:3", "links.md:4", "code.rs:1: HEARSAY.md"] {
        assert!(said.contains(problem), "{problem}: {said}");
    }
}

#[test]
fn a_contents_list_that_lacks_a_heading_is_named() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let args = ["--root", folder.path().to_str().expect("a readable path")];
    let document = "# All\n\n- [One](#one)\n\n## One\n\n## Two\n";
    std::fs::write(folder.path().join("all.md"), document).expect("a writable file");
    let (content, said) = script("links.py", &args);
    assert!(!content && said.contains("all.md:7") && said.contains("`Two`"), "{said}");
}

#[test]
fn the_front_door_is_one_page() {
    let size = std::fs::metadata(root().join("README.md")).expect("it is there").len();
    assert!(size <= 8192, "README.md has {size} bytes: move what is not for strangers to another document");
}

#[test]
fn documents_are_read_to_the_end() {
    for (name, limit, instead) in [
        ("format-spec/RATIONALE.md", 60_000, "trials belong in format-spec/trials"),
        ("CHANGELOG.md", 6_000, "details belong in the document of the command or crate"),
        ("tests/RESULTS.md", 50_000, "figures of earlier builders belong in format-spec/trials, or go"),
    ] {
        let size = std::fs::metadata(root().join(name)).expect("it is there").len();
        assert!(size <= limit, "{name} has {size} bytes, at most {limit}: {instead}");
    }
}

#[test]
fn figures_that_stand_in_several_documents_agree() {
    let (content, said) = script("figures.py", &[]);
    assert!(content, "{said}");
}

#[test]
fn a_figure_that_says_something_else_than_another_is_named() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    for name in ["README.md", "cli/README.md", "reader/README.md", "tests/RESULTS.md"] {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("it has a folder")).expect("a writable temporary directory");
        std::fs::copy(root().join(name), path).expect("a readable document");
    }
    let args = ["--root", folder.path().to_str().expect("a readable path")];
    let (content, said) = script("figures.py", &args);
    assert!(content, "{said}");
    let file = folder.path().join("README.md");
    let text = std::fs::read_to_string(&file).expect("it was copied");
    std::fs::write(&file, text.replacen("**0.43 mean edges**", "**0.44 mean edges**", 1)).expect("a writable file");
    let (content, said) = script("figures.py", &args);
    assert!(!content && said.contains("largest distance at 10 %: README.md says 0.44"), "{said}");
    std::fs::write(&file, text.replacen("mean edges**, proven", "mean edges**", 1)).expect("a writable file");
    let (content, said) = script("figures.py", &args);
    assert!(!content && said.contains("there is no `**{} mean edges**, proven`"), "{said}");
}

#[test]
fn comments_keep_the_width_of_code() {
    let (content, said) = script("columns.py", &[]);
    assert!(content, "{said}");
}

#[test]
fn a_wide_comment_is_named_and_wide_code_is_not() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let args = ["--root", folder.path().to_str().expect("a readable path")];
    let wide = "word ".repeat(30);
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("a writable file");
    write("a.rs", &format!("const A: &str = \"{wide}\";\n// {}\n", "x".repeat(140)));
    write("b.py", &format!("A = \"{wide}\"\n"));
    let (content, said) = script("columns.py", &args);
    assert!(content, "{said}");
    write("a.rs", &format!("fn a() {{}}\n\n/// {wide}\n"));
    write("b.py", &format!("def b():\n    \"\"\"{wide}\"\"\"\n"));
    write("c.js", &format!("/**\n * {wide}\n */\n"));
    let (content, said) = script("columns.py", &args);
    assert!(!content, "{said}");
    for problem in ["a.rs:3: 154 columns", "b.py:2: 160 columns", "c.js:2: 153 columns"] {
        assert!(said.contains(problem), "{problem}: {said}");
    }
}
