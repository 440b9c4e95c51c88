//! Commands as people type them: what is called how where nobody names it, programs that are started, shells and man
//! pages.

use crate::commands::lodpack;
use lodpack_tests::generate::{bumpy_sphere, save_ply};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A directory to type in, with mesh.obj.
struct Desk(tempfile::TempDir);

impl Desk {
    fn new() -> Self {
        let dir = tempfile::tempdir().expect("a temporary directory");
        fs::write(dir.path().join("mesh.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n")
            .expect("writable");
        Self(dir)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Runs a line in a shell that finds `lodpack`.
    fn run(&self, line: &str) -> Output {
        let program = Path::new(env!("CARGO_BIN_EXE_lodpack"));
        let path = std::env::var("PATH").unwrap_or_default();
        let path = format!("{}:{path}", program.parent().expect("it is in a directory").display());
        let mut shell = Command::new("sh");
        shell.current_dir(self.0.path()).env("PATH", path).args(["-c", line]).output().expect("a shell starts")
    }

    /// What is said on stdout and stderr.
    fn ok(&self, line: &str) -> [String; 2] {
        let out = self.run(line);
        let said = [&out.stdout, &out.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        assert!(out.status.success(), "{line}: {said:?}");
        said
    }

    fn refused(&self, line: &str) -> String {
        let out = self.run(line);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{line}: {said}");
        said
    }
}

#[test]
#[cfg(unix)]
fn build_info_and_merge_work_as_typed() {
    let desk = Desk::new();
    // Parts that somebody has carried here, without their job.
    desk.ok("lodpack plan mesh.obj -o elsewhere && lodpack build --job elsewhere --part 0 && mv elsewhere/parts . && rm -r elsewhere");
    let [said, _] = desk.ok("lodpack build mesh.obj && lodpack info mesh.lodpack && lodpack merge parts/");
    assert!(said.contains("mesh.lodpack: lodpack ") && said.contains("parts.lodpack"), "{said}");
    assert!(desk.bytes("mesh.lodpack") == desk.bytes("parts.lodpack"));
    // Never over an existing file without being told to.
    for line in ["lodpack build mesh.obj", "lodpack merge parts/", "lodpack merge parts"] {
        assert!(desk.refused(line).contains("exists; pass --force"), "{line}");
    }
    desk.ok("lodpack build mesh.obj --force && lodpack merge parts/ --force");
}

#[test]
#[cfg(unix)]
fn a_job_and_its_file_are_called_after_the_input() {
    let desk = Desk::new();
    let [said, _] = desk.ok("lodpack plan mesh.obj");
    assert!(said.contains("lodpack merge mesh.job") && said.contains("writes mesh.lodpack"), "{said}");
    assert!(desk.refused("lodpack merge mesh.job").contains("part 0 is missing"));
    assert!(!desk.path("mesh.lodpack").exists());
    desk.ok("lodpack build --job mesh.job --part 0");
    desk.ok("lodpack build mesh.obj -o expected");
    for line in [
        "lodpack merge mesh.job",
        "lodpack merge mesh.job/",
        "lodpack merge ./mesh.job/parts",
        "lodpack merge mesh.job/parts/part-0.lodpart",
        "cd mesh.job && lodpack merge parts/",
        "cd mesh.job && lodpack merge .",
        "cd mesh.job/parts && lodpack merge .",
        "cd mesh.job/parts && lodpack merge *.lodpart",
    ] {
        desk.ok(line);
        assert!(desk.bytes("mesh.lodpack") == desk.bytes("expected"), "{line}");
        fs::remove_file(desk.path("mesh.lodpack")).expect("removable");
    }
    // A job with a name of its own gives that to its file; any other has its input's.
    desk.ok("lodpack plan mesh.obj -o land.job && lodpack build --job land.job --part 0 && lodpack merge land.job");
    assert!(desk.bytes("land.lodpack") == desk.bytes("expected"));
    desk.ok("lodpack plan mesh.obj -o job/ && lodpack build --job job/ --part 0 && lodpack merge job/");
    assert!(desk.bytes("mesh.lodpack") == desk.bytes("expected"));
    let said = desk.refused("cp job/parts/*.lodpart . && lodpack merge part-0.lodpart");
    assert!(said.contains("-o OUT.lodpack"), "{said}");
}

#[test]
#[cfg(unix)]
fn a_file_that_is_submitted_for_has_the_planned_name_and_must_not_be_there() {
    let desk = Desk::new();
    desk.ok("lodpack plan mesh.obj");
    let [said, _] = desk.ok("lodpack submit mesh.job --dry-run");
    assert!(said.contains("/mesh.lodpack") && said.contains("/mesh.job"), "{said}");
    fs::write(desk.path("mesh.lodpack"), "precious").expect("writable");
    let said = desk.refused("lodpack submit mesh.job --dry-run");
    assert!(said.contains("mesh.lodpack exists") && said.contains("-o mesh.lodpack"), "{said}");
    desk.ok("lodpack submit mesh.job --dry-run -o mesh.lodpack");
    assert!(desk.refused("lodpack submit nowhere --dry-run").contains("nowhere"));
}

#[test]
#[cfg(unix)]
fn several_inputs_and_directories_name_their_file() {
    let desk = Desk::new();
    fs::create_dir(desk.path("far")).expect("made");
    save_ply(&bumpy_sphere(8), &desk.path("far/ball.v2.ply")).expect("written");
    let [said, noted] = desk.ok("lodpack build far/ball.v2.ply mesh.obj");
    assert!(desk.path("far/ball.v2.lodpack").exists() && said.starts_with("far/ball.v2.lodpack"), "{said}");
    assert!(noted.contains("named after the first"), "{noted}");
    desk.ok("lodpack atlas far/ball.v2.ply -o atlas && lodpack build atlas/");
    assert!(desk.path("atlas.lodpack").exists());
    desk.ok("cd atlas && lodpack build . --force");
    // What is wrong with an input is not told of an output that nobody has named.
    assert!(desk.refused("lodpack build no/where.obj").contains("no/where.obj: cannot be read"));
    let said = desk.refused("lodpack build atlas.lodpack");
    assert!(said.contains("a file is not built onto itself"), "{said}");
}

#[test]
#[cfg(unix)]
fn view_starts_the_viewer_that_is_beside_it_or_in_path() {
    let desk = Desk::new();
    // In the build's own directory, so that the program can be linked; the stand-in for the viewer prints its
    // arguments.
    let place = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a temporary directory");
    let [own, other] = ["own", "other"].map(|name| place.path().join(name));
    [&own, &other].into_iter().for_each(|folder| fs::create_dir(folder).expect("made"));
    let program = own.join("lodpack");
    fs::hard_link(env!("CARGO_BIN_EXE_lodpack"), &program).expect("linked");
    let view = |words: &[&str]| {
        let mut command = Command::new(&program);
        let out =
            command.current_dir(desk.0.path()).env("PATH", &other).arg("view").args(words).output().expect("it starts");
        let text = String::from_utf8_lossy(if out.status.success() { &out.stdout } else { &out.stderr }).into_owned();
        (out.status.code(), text)
    };
    let (code, said) = view(&["mesh.lodpack"]);
    assert!(code == Some(2) && said.contains("cargo install --path viewer-min"), "{said}");
    let stand_in = |folder: &Path, program: &str| {
        std::os::unix::fs::symlink(program, folder.join("lodpack-view")).expect("linked");
    };
    stand_in(&other, "/bin/echo");
    let typed = ["mesh.lodpack", "--tolerance", "2", "-x", "--help"];
    assert_eq!(view(&typed), (Some(0), format!("{}\n", typed.join(" "))));
    assert_eq!(view(&["--check", "a", "--against", "b"]), (Some(0), "--check a --against b\n".into()));
    // The one beside lodpack comes first, and its exit status is the command's.
    stand_in(&own, "/bin/false");
    assert_eq!(view(&["mesh.lodpack"]).0, Some(1));
    let (code, said) = view(&[]);
    assert!(code == Some(2) && said.contains("FILE"), "{said}");
    assert!(view(&["--help"]).1.contains("lodpack view scan.lodpack"));
    assert!(lodpack().args(["view", "--help"]).output().expect("it starts").status.success());
}

#[test]
#[cfg(unix)]
fn shells_get_completions_that_they_can_read() {
    let desk = Desk::new();
    for (shell, word) in [
        ("bash", "complete -F _lodpack"),
        ("zsh", "#compdef lodpack"),
        ("fish", "complete -c lodpack"),
        ("elvish", "edit:completion"),
        ("powershell", "Register-ArgumentCompleter"),
    ] {
        let [script, _] = desk.ok(&format!("lodpack completions {shell} | tee completions.{shell}"));
        assert!(script.contains(word), "{shell}");
        for offered in ["extract", "tolerance", "effort", "resume"] {
            assert!(script.contains(offered), "{shell}: {offered}");
        }
    }
    desk.ok("if command -v bash; then bash -n completions.bash; fi");
    assert!(desk.refused("lodpack completions tcl").contains("bash, elvish, fish, powershell, zsh"));
}

#[test]
#[cfg(unix)]
fn every_command_has_a_manual_page_with_examples() {
    let desk = Desk::new();
    let [page, _] = desk.ok("lodpack man");
    let [help, _] = desk.ok("lodpack --help");
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // Descriptions that are wrapped go on further to the right.
    let commands = commands.filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    let commands: Vec<&str> =
        commands.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help").collect();
    assert!(commands.len() > 10, "{help}");
    desk.ok("lodpack man -o pages");
    assert_eq!(fs::read_dir(desk.path("pages")).expect("written").count(), commands.len() + 1);
    assert_eq!(desk.bytes("pages/lodpack.1"), page.into_bytes());
    for command in commands {
        let page = String::from_utf8(desk.bytes(&format!("pages/lodpack-{command}.1"))).expect("UTF-8");
        let examples = page.split_once(".SH EXAMPLES\n.nf\n").map(|(_, examples)| examples);
        let is_shown = examples.is_some_and(|examples| examples.contains(&format!("lodpack {command}")));
        assert!(page.contains(".SH OPTIONS\n") && is_shown, "{page}");
        assert_eq!(desk.ok(&format!("lodpack man {command}"))[0], page, "{command}");
    }
    // Whatever formats pages here finds nothing to complain about.
    let [_, complaints] = desk.ok("if command -v groff; then groff -man -Tutf8 -ww -z pages/*.1; fi");
    assert_eq!(complaints, "");
    assert!(desk.refused("lodpack man -o pages").contains("exists; pass --force"));
    desk.ok("lodpack man -o pages --force");
    assert!(desk.refused("lodpack man nonsense").contains("'nonsense'"));
    assert!(desk.refused("lodpack man -o mesh.obj").contains("is a file"));
}
