//! The header is that of the sources, and a program in C reads every file with it.
//!
//! The program is compiled with the system's C compiler. Without one, or without valgrind, the tests say so and are
//! skipped, unless `LODPACK_REQUIRE_C` is set, as in CI.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

#[allow(dead_code, reason = "a module of the tests' library, which is not used as one here: it depends on the builder")]
#[path = "../../../tests/src/corpus.rs"]
mod corpus;

fn package() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn vectors() -> PathBuf {
    package().join("../../format-spec/vectors")
}

/// A file of a torus of 2,304 triangles with colours, normals and a number at each vertex.
fn painted() -> PathBuf {
    package().join("tests/painted.lodpack")
}

/// The sound files: meshes, heights, and one that has channels whose texels are real.
fn sound() -> Vec<PathBuf> {
    [lodpack_files(&vectors()), lodpack_files(&vectors().join("heights")), vec![painted()]].concat()
}

/// The files of a folder that are lodpack files by their names.
fn lodpack_files(folder: &Path) -> Vec<PathBuf> {
    let entries =
        std::fs::read_dir(folder).expect("the vectors are there").map(|entry| entry.expect("readable").path());
    let mut files: Vec<_> = entries.filter(|path| path.extension().is_some_and(|ending| ending == "lodpack")).collect();
    files.sort();
    files
}

/// Whether a program is there; without it a test is skipped.
fn is_there(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok_and(|out| out.status.success());
    assert!(found || std::env::var_os("LODPACK_REQUIRE_C").is_none(), "{program} is not installed");
    if !found {
        println!("skipped: no {program}");
    }
    found
}

fn text(out: &Output) -> String {
    String::from_utf8_lossy(&[out.stdout.as_slice(), &out.stderr].concat()).into_owned()
}

fn succeeds(command: &mut Command) -> String {
    // Cargo's would have an older library come first.
    let out = command.env_remove("LD_LIBRARY_PATH").output().expect("it starts");
    assert!(out.status.success(), "{command:?}: {}", text(&out));
    text(&out)
}

/// Compiles a program of tests/ against the shared or the static library.
fn compile(source: &str, is_static: bool, into: &Path) -> PathBuf {
    // Cargo has built the library beside this test.
    let mut built = std::env::current_exe().expect("it has a name");
    built.pop();
    let name = Path::new(source).file_name().expect("a program");
    let program = into.join(name).with_extension(if is_static { "static" } else { "shared" });
    let mut compiler = Command::new("cc");
    compiler.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-g", "-O1", "-I"]);
    compiler.arg(package().join("include")).arg(package().join("tests").join(source)).arg("-o").arg(&program);
    match is_static {
        true => compiler.arg(built.join("liblodpack_c.a")).args(["-lpthread", "-ldl", "-lm"]),
        false => {
            compiler.arg("-L").arg(&built).arg("-llodpack_c").arg(format!("-Wl,-rpath,{}", built.display())).arg("-lm")
        }
    };
    succeeds(&mut compiler);
    program
}

/// What Rust's standard library keeps of a thread is reached by a pointer to its middle, so it would count as possibly
/// lost.
const VALGRIND: [&str; 4] =
    ["--quiet", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite,indirect"];

#[test]
fn the_header_is_that_of_the_sources() {
    let config = cbindgen::Config::from_file(package().join("cbindgen.toml")).expect("a sound configuration");
    let mut header = vec![];
    cbindgen::generate_with_config(package(), config).expect("the sources make a header").write(&mut header);
    let path = package().join("include/lodpack.h");
    if std::env::var_os("LODPACK_WRITE_HEADER").is_some() {
        std::fs::write(&path, &header).expect("writable");
    }
    let there = std::fs::read(&path).unwrap_or_default();
    assert!(there == header, "include/lodpack.h is not of today: LODPACK_WRITE_HEADER=1 cargo test -p lodpack-c");
}

#[test]
fn the_header_and_the_example_are_sound_c_and_cpp() {
    for (compiler, language, standard) in [("cc", "c", "-std=c99"), ("c++", "c++", "-std=c++11")] {
        if is_there(compiler) {
            let mut command = Command::new(compiler);
            command.args(["-x", language, standard, "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only"]);
            succeeds(command.arg(package().join("include/lodpack.h")));
            let mut command = Command::new(compiler);
            command.args(["-x", language, standard, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I"]);
            succeeds(command.arg(package().join("include")).arg(package().join("examples/extract.c")));
        }
    }
}

#[test]
fn a_program_reads_sound_files_and_survives_all_others_without_a_leak() {
    if !is_there("cc") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary directory");
    let invalid = lodpack_files(&vectors().join("invalid"));
    let sound = sound();
    assert!(invalid.len() > 100 && sound.len() > 20);
    let programs = [compile("reads.c", false, dir.path()), compile("reads.c", true, dir.path())];
    for program in &programs {
        let said = succeeds(Command::new(program).arg("sound").args(&sound));
        assert!(said.contains("files, all as expected"), "{said}");
        succeeds(Command::new(program).arg("invalid").args(&invalid));
        // Three channels, in each of the three ways to open the file; and what a flight shows.
        let said = succeeds(Command::new(program).arg("sound").arg(painted()));
        assert_eq!((number(&said, "channels"), number(&said, "frames")), (9, 6), "{said}");
        assert_eq!(number(&said, "lossless"), 0, "{said}");
        // All four of this one are stored without loss.
        let said = succeeds(Command::new(program).arg("sound").arg(vectors().join("exact_colours.lodpack")));
        assert_eq!((number(&said, "channels"), number(&said, "lossless")), (12, 12), "{said}");
        // Its ground in each of these ways, each with a flight, and one of the mesh.
        let said = succeeds(Command::new(program).arg("sound").arg(vectors().join("ground.lodpack")));
        assert_eq!((number(&said, "grounds"), number(&said, "frames")), (3, 24), "{said}");
    }
    if is_there("valgrind") {
        for (kind, files) in [("sound", &sound), ("invalid", &invalid)] {
            succeeds(Command::new("valgrind").args(VALGRIND).arg(&programs[0]).arg(kind).args(files));
        }
    }
}

/// The number before a word.
fn number(said: &str, word: &str) -> usize {
    let before = said.split(word).next().and_then(|before| before.trim().rsplit([' ', '\n']).next());
    before.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("no number of {word}: {said}"))
}

#[test]
fn changed_files_with_right_checksums_are_refused_or_drawn_without_a_leak() {
    if !is_there("cc") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary directory");
    let program = compile("reads.c", false, dir.path());
    let mut seeds = corpus::vectors();
    seeds.push(corpus::Seed::new("painted", std::fs::read(painted()).expect("a readable file")));
    // Valgrind takes fifty times as long, so it gets a share of them.
    for (count, checker) in [(64, None), (1, Some("valgrind"))] {
        let folder = dir.path().join(count.to_string());
        let files = corpus::corpus(&seeds, count);
        corpus::write_corpus(&folder, &files).expect("a writable folder");
        let mut command = match checker {
            Some(checker) if !is_there(checker) => continue,
            Some(checker) => {
                let mut command = Command::new(checker);
                command.args(VALGRIND).arg(&program);
                command
            }
            None => Command::new(&program),
        };
        let said = succeeds(command.arg("hostile").args(lodpack_files(&folder)));
        assert!(said.contains("all as expected"), "{said}");
        println!("{said}");
        // Otherwise all were refused at the door.
        let (opened, drawn) = (number(&said, "opened"), number(&said, "meshes"));
        assert!(opened > files.len() / 4 && opened < files.len() * 3 / 4 && drawn > opened, "{said}");
    }
}

#[test]
fn the_example_of_the_readme_draws_a_file() {
    if !is_there("cc") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary directory");
    let program = compile("../examples/extract.c", false, dir.path());
    let file = vectors().join("tree.lodpack");
    let obj = succeeds(Command::new(&program).arg(&file).arg("0.5"));
    assert!(obj.lines().any(|line| line.starts_with("v ")) && obj.lines().any(|line| line.starts_with("f ")), "{obj}");
    // A ground is written in the space of its mesh, behind it: the header of each, and corners that continue.
    let obj = succeeds(Command::new(&program).arg(vectors().join("ground.lodpack")).arg("0"));
    let found = |begin: &str| obj.lines().filter(|line| line.starts_with(begin)).collect::<Vec<_>>();
    let (vertices, last) = (found("v "), found("f ").pop().expect("a triangle"));
    assert_eq!(found("# ").len(), 2, "{obj}");
    assert!(last.split(' ').skip(1).any(|corner| corner == vertices.len().to_string()), "{obj}");
    // Heights alone are written, too.
    let obj = succeeds(Command::new(&program).arg(vectors().join("heights/cell.lodpack")).arg("0"));
    assert!(obj.lines().any(|line| line.starts_with("f ")), "{obj}");
    let wrong = Command::new(&program).arg(dir.path().join("nowhere.lodpack")).arg("1").output().expect("it starts");
    assert!(!wrong.status.success() && text(&wrong).contains("nowhere.lodpack: No such file"), "{}", text(&wrong));
}

#[test]
fn objects_are_found_hidden_shown_alone_and_picked_without_a_leak() {
    if !is_there("cc") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary directory");
    let program = compile("objects.c", false, dir.path());
    let files =
        ["objects", "object_by_hand", "torus", "heights/cell"].map(|name| vectors().join(format!("{name}.lodpack")));
    let said = succeeds(Command::new(&program).args(&files));
    assert!(number(&said, "nodes") > 20 && number(&said, "picks") > 5, "{said}");
    if is_there("valgrind") {
        succeeds(Command::new("valgrind").args(VALGRIND).arg(&program).args(&files[1..]));
    }
}

#[test]
fn queries_are_answered_as_in_every_other_language() {
    if !is_there("cc") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary directory");
    let program = compile("queries.c", false, dir.path());
    let table = package().join("../../tests/data/queries.txt");
    let said = succeeds(Command::new(&program).arg(table).arg(vectors()));
    assert!(said.contains(" 0 answered otherwise"), "{said}");
}
