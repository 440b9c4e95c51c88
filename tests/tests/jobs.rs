//! Builds in parts, and builds that are stopped and resumed, as people run them.

use crate::commands::lodpack;
use crate::{open, scan};
use lodpack_tests::generate::{bumpy_sphere, save_ply};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::LazyLock;
use std::time::Duration;

/// Triangles per region. The scan then has about twenty regions.
pub const REGION: &str = "8000";

/// The bytes of a build in memory.
pub fn expected() -> &'static [u8] {
    static EXPECTED: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let out = dir.path().join("out.lodpack");
        lodpack().arg("build").arg(scan()).args(["--region-triangles", REGION, "-o"]).arg(&out).assert().success();
        fs::read(out).expect("written")
    });
    &EXPECTED
}

/// A folder in which the program runs.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A command of the program in the folder; the word `SCAN` stands for the scan.
    pub fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodpack"));
        command.current_dir(self.0.path());
        for word in words.split_whitespace() {
            match word {
                "SCAN" => command.arg(scan()).args(["--region-triangles", REGION]),
                word => command.arg(word),
            };
        }
        command
    }

    pub fn run(&self, words: &str) -> Output {
        self.command(words).output().expect("the program starts")
    }

    pub fn ok(&self, words: &str) -> String {
        let out = self.run(words);
        assert!(out.status.success(), "{words}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).into_owned()
    }

    /// As [`Self::ok`], where the job may be unfinished.
    pub fn ok_or_unfinished(&self, words: &str) -> String {
        let out = self.run(words);
        assert!(matches!(out.status.code(), Some(0 | 1)), "{words}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).into_owned()
    }

    /// Expects exit status 2 and one message.
    pub fn refused(&self, words: &str) -> String {
        let out = self.run(words);
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{words}: {message}");
        assert!(!message.contains("panicked"), "{message}");
        message
    }

    pub fn built(&self, name: &str) -> bool {
        fs::read(self.path(name)).expect("written") == expected()
    }
}

/// Enough memory to build the scan on disk, region by region.
const LITTLE: &str = "--memory 26MiB";

#[test]
fn a_job_goes_from_plan_to_file() {
    let folder = Folder::new();
    let plan = folder.ok("plan SCAN -o job --parts 3");
    assert!(plan.contains("lodpack build --job job --part K"), "{plan}");
    assert_eq!(folder.run("status job").status.code(), Some(1));
    folder.ok("build --job job --part 2");
    let message = folder.refused("merge job -o out.lodpack");
    assert!(message.contains("2 of 3 parts") && message.contains("`lodpack build --job job --part 0`"), "{message}");
    assert!(!folder.path("out.lodpack").exists());
    folder.ok("build --job job --part 0-2 --json");
    let status: serde_json::Value = serde_json::from_str(&folder.ok("status job --json")).expect("JSON");
    assert!(status["parts"].as_array().expect("parts").iter().all(|part| part["state"] == "done"), "{status}");
    folder.ok("merge job -o out.lodpack --json");
    assert!(folder.built("out.lodpack"));
    // An existing file is neither overwritten nor in the way.
    folder.refused("merge job -o out.lodpack");
    assert!(folder.refused("plan SCAN -o job").contains("--resume"));
    folder.ok("plan SCAN -o job --parts 5 --force");
    assert!(folder.refused("merge job -o other.lodpack").contains("5 of 5 parts"));
    // Only files of a job are removed.
    fs::write(folder.path("job/thesis.tex"), "years of work").expect("written");
    assert!(folder.refused("plan SCAN -o job --force").contains("thesis.tex"));
}

#[test]
fn impossible_parts_are_refused_before_anything_is_done() {
    let folder = Folder::new();
    let message = folder.refused("plan SCAN -o job --part-memory 1MB");
    assert!(message.contains("--part-memory 0.95MiB is too little") && !folder.path("job").exists(), "{message}");
    // A finished plan is not thrown away because of the parts.
    let message = folder.refused("plan SCAN -o job --part-memory 24.5MiB");
    assert!(message.contains("--part-memory 24MiB is too little") && message.contains("--resume"), "{message}");
    folder.ok("plan SCAN -o job --part-memory 1GB --parts 4 --resume");
    let message = folder.refused("build --job job --part 3-9");
    assert!(message.contains("no part 9") && !folder.path("job/parts/part-3.lodpart").exists(), "{message}");
    let out = folder.run("plan SCAN -o many --parts 64");
    assert!(String::from_utf8_lossy(&out.stderr).contains("of 64 parts have nothing to do"), "{out:?}");
    // A plan of an unreadable input leaves nothing.
    folder.refused("plan nothing.ply -o other");
    assert!(!folder.path("other").exists());
}

#[test]
fn the_bytes_do_not_depend_on_memory() {
    let folder = Folder::new();
    for memory in ["26MiB", "29MiB", "34MiB"] {
        let out = folder.ok(&format!("build SCAN --memory {memory} -o out.lodpack --force --json"));
        let summary: serde_json::Value = serde_json::from_str(&out).expect("JSON");
        assert!(summary["temporary_bytes"].as_u64() > Some(0), "{memory} was enough");
        assert!(folder.built("out.lodpack"), "{memory}");
        assert_eq!(fs::read_dir(folder.0.path()).expect("readable").count(), 1, "something was left behind");
    }
}

#[test]
fn progress_is_honest_and_machine_readable() {
    let folder = Folder::new();
    let lines_of = |words: &str| -> Vec<serde_json::Value> {
        let text = String::from_utf8_lossy(&folder.run(words).stderr).into_owned();
        text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("no JSON: {line}"))).collect()
    };
    for (words, least) in [
        (format!("build SCAN {LITTLE} -o out.lodpack"), 5),
        ("plan SCAN -o job --parts 3".into(), 4),
        ("build --job job --part 0-2".into(), 4),
        ("build --job job --part 1".into(), 2),
        ("merge job -o merged.lodpack".into(), 3),
    ] {
        let lines = lines_of(&format!("{words} --progress json"));
        let percent: Vec<f64> = lines.iter().filter_map(|line| line["percent"].as_f64()).collect();
        assert!(percent.len() >= least && percent.is_sorted(), "{words}: {percent:?}");
        assert_eq!((percent[0], percent[percent.len() - 1]), (0.0, 100.0), "{words}");
        assert_eq!(lines[0]["remaining_seconds"], serde_json::Value::Null, "{words}");
        let progress = || lines.iter().filter(|line| line["note"].is_null());
        assert!(progress().all(|line| line["memory_bytes"].as_u64() > Some(0)));
        let has_disk = progress().any(|line| line["disk_bytes"].as_u64() > Some(1 << 20));
        assert_eq!(has_disk, !words.contains("job job") && !words.contains("merge"), "{words}");
    }
    // Errors too, including errors on the command line.
    for words in ["merge nowhere -o out.lodpack", "build --job job --part 0-3", "merge"] {
        let lines = lines_of(&format!("{words} --progress json"));
        assert!(lines.last().is_some_and(|line| line["error"].is_string()), "{words}: {lines:?}");
    }
}

/// When to kill: early at first, so that every step is met however fast the machine is, and late enough in the end for
/// a build to finish.
pub fn later(round: i32) -> Duration {
    Duration::from_secs_f64(0.01 * 1.3_f64.powi(round))
}

/// Kills a command after a while. Returns whether it was still running.
pub fn killed(mut command: Command, after: Duration, signal: &str) -> (bool, String) {
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts");
    let pid = child.id().to_string();
    std::thread::sleep(after);
    let _ = Command::new("kill").args([signal, &pid]).stderr(Stdio::null()).status();
    let out = child.wait_with_output().expect("it ends");
    (!out.status.success(), String::from_utf8_lossy(&out.stderr).into_owned())
}

/// Kills a build that resumes, again and again and later each time, until one gets to its end. Returns how often it was
/// killed.
pub fn kills_until_built(folder: &Folder, build: &str, first: i32) -> u32 {
    let mut kills = 0;
    for round in first.. {
        let (was_running, _) = killed(folder.command(build), later(round), "-KILL");
        if !was_running {
            break;
        }
        kills += 1;
        // The signal may come between the last rename and the end of the process, which then leaves its state behind.
        if folder.path("out.lodpack").exists() {
            assert!(folder.built("out.lodpack"), "a file has its final name before it is finished");
            if folder.path("out.lodpack.building").exists() {
                folder.ok(build);
            }
            break;
        }
    }
    kills
}

#[test]
fn a_build_killed_again_and_again_ends_with_the_same_bytes() {
    let folder = Folder::new();
    let kills = kills_until_built(&folder, &format!("build SCAN {LITTLE} -o out.lodpack --resume"), 0);
    assert!(kills > 1 && folder.built("out.lodpack"), "{kills}");
    assert_eq!(fs::read_dir(folder.0.path()).expect("readable").count(), 1, "something was left behind");
}

#[test]
fn plans_parts_and_merges_can_be_killed() {
    let folder = Folder::new();
    for (words, product) in [
        ("plan SCAN -o job --parts 2 --resume", "job/job.json"),
        ("build --job job --part 0", "job/parts/part-0.lodpart"),
        ("build --job job --part 1", "job/parts/part-1.lodpart"),
        ("merge job -o out.lodpack --force", "out.lodpack"),
    ] {
        for round in 0.. {
            let (was_running, _) = killed(folder.command(words), later(round), "-KILL");
            if !was_running {
                break;
            }
            // What has its final name is finished: the signal came between the last rename and the end of the process.
            // Whether it is whole, the merge and the comparison below will tell.
            if product != "job/job.json" && folder.path(product).exists() {
                break;
            }
        }
    }
    assert!(folder.built("out.lodpack"));
    assert!(
        !fs::read_dir(folder.0.path())
            .expect("readable")
            .flatten()
            .any(|e| e.path().extension().is_some_and(|x| x == "tmp"))
    );
}

#[test]
fn adding_meshes_later_gives_the_file_of_a_build_at_once() {
    let folder = Folder::new();
    let mut sphere = bumpy_sphere(24);
    sphere.positions.iter_mut().for_each(|p| p[0] += 4.0);
    save_ply(&sphere, &folder.path("sphere.ply")).expect("written");
    let options = "--extensible --tolerance 0.04";
    assert!(folder.refused("plan SCAN --extensible -o job").contains("--tolerance as a length"));
    folder.ok(&format!("plan SCAN {options} -o job --parts 3"));
    folder.ok("build --job job --part 0-2");
    let add = "add job sphere.ply -o more --parts 2 --resume --json";
    let added = (0..).find_map(|round| {
        let (was_running, _) = killed(folder.command(add), later(round), "-KILL");
        (!was_running).then(|| folder.ok(add))
    });
    let added: serde_json::Value = serde_json::from_str(&added.expect("it ends")).expect("JSON");
    let [taken_over, regions] = ["taken_over", "regions"].map(|name| added[name].as_u64().expect("a number"));
    assert!(taken_over > 4 && taken_over < regions, "{taken_over} of {regions}");
    assert!(folder.refused("add job sphere.ply -o more").contains("--resume"));
    assert!(folder.ok("add job sphere.ply -o more --parts 2 --force").contains("are already built"));
    folder.ok("build --job more --part 0-1");
    folder.ok("merge more -o added.lodpack");
    folder.ok(&format!("build SCAN sphere.ply {options} -o at-once.lodpack"));
    let bytes = |name: &str| fs::read(folder.path(name)).expect("written");
    assert!(bytes("added.lodpack") == bytes("at-once.lodpack"));
    folder.ok("verify added.lodpack --cuts 20");
    let added = bytes("added.lodpack");
    let file = open(&added);
    let top = file.uniform_cut(0).expect("a level");
    assert!(file.top_count() == 1 && top.triangle_count <= 500, "{} tops, {}", file.top_count(), top.triangle_count);
    assert!(folder.refused("add job sphere.ply -o ./job --force").contains("another directory"));
    assert!(folder.path("job/job.json").exists());
    assert!(folder.refused("add job nothing.ply -o other").contains("nothing.ply"));
    assert!(folder.refused("add nowhere sphere.ply -o other").contains("nowhere"));
    assert!(folder.refused("add added.lodpack sphere.ply -o other").contains("name the job"));
}

#[test]
fn ctrl_c_and_sigterm_say_how_to_resume() {
    let folder = Folder::new();
    for signal in ["-INT", "-TERM"] {
        // Later and later, until there is something to resume. A signal that is too early may be missed, or arrive
        // after the end.
        let stopped = (0..40).any(|round| {
            let command = folder.command(&format!("build SCAN {LITTLE} -o out.lodpack --force"));
            let (_, message) = killed(command, later(round), signal);
            if folder.path("out.lodpack").exists() {
                assert!(folder.built("out.lodpack"), "a file has its final name before it is finished: {message}");
                fs::remove_file(folder.path("out.lodpack")).expect("removed");
            }
            let has_begun = folder.path("out.lodpack.building/job.json").exists();
            has_begun && message.contains("stopped: run the same command with --resume to continue")
        });
        assert!(stopped, "{signal}");
        assert!(!folder.path("out.lodpack").exists());
        let refusal = folder.refused(&format!("build SCAN {LITTLE} -o out.lodpack"));
        assert!(refusal.contains("--resume"), "{refusal}");
        // Other options make another build.
        let refusal = folder.refused(&format!("build SCAN {LITTLE} -o out.lodpack --resume --tolerance 1%"));
        assert!(refusal.contains("begun with other options") && !refusal.contains("is kept"), "{refusal}");
        folder.ok(&format!("build SCAN {LITTLE} -o out.lodpack --resume"));
        assert!(folder.built("out.lodpack"));
        fs::remove_file(folder.path("out.lodpack")).expect("removed");
    }
}

#[test]
fn stopped_commands_leave_nothing_and_exit_with_130() {
    let folder = Folder::new();
    let temp = folder.path("temp");
    fs::create_dir(&temp).expect("made");
    let atlas = format!("atlas {} -o atlas", scan().display());
    for words in ["selftest --temp temp --case fan --case finger", &atlas] {
        let stopped = (4..24).any(|round| {
            let child = folder.command(words).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
            let mut child = child.expect("the program starts");
            std::thread::sleep(later(round));
            let _ = Command::new("kill").args(["-TERM", &child.id().to_string()]).stderr(Stdio::null()).status();
            let status = child.wait().expect("it ends");
            assert_eq!(fs::read_dir(&temp).expect("readable").count(), 0, "{words}");
            if status.success() {
                assert!(folder.path("atlas/atlas.json").exists() || words != atlas);
                let _ = fs::remove_dir_all(folder.path("atlas"));
            } else {
                assert!(!folder.path("atlas").exists(), "{words}");
            }
            status.code() == Some(130)
        });
        assert!(stopped, "{words}");
    }
}

#[test]
fn an_atlas_on_a_full_disk_reports_it_once_and_leaves_nothing() {
    let folder = Folder::new();
    let command = folder.command(&format!("atlas {} -o atlas", scan().display()));
    let mut shell = Command::new("sh");
    shell.current_dir(folder.0.path()).args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$@\"", "sh"]);
    let out = shell.arg(command.get_program()).args(command.get_args()).output().expect("the shell starts");
    let message = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{message}");
    assert_eq!(message.matches("too large").count(), 1, "{message}");
    assert!(message.contains("cannot be written") && !folder.path("atlas").exists(), "{message}");
}

#[test]
fn an_input_that_changes_during_a_build_is_noticed_on_resume() {
    let folder = Folder::new();
    let mesh = folder.path("mesh.ply");
    fs::copy(scan(), &mesh).expect("copied");
    let build = format!("build mesh.ply --region-triangles {REGION} {LITTLE} -o out.lodpack");
    for round in 0..40 {
        killed(folder.command(&format!("{build} --force")), later(round), "-TERM");
        if folder.path("out.lodpack.building/job.json").exists() {
            break;
        }
    }
    let mut bytes = fs::read(&mesh).expect("readable");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&mesh, bytes).expect("written");
    let message = folder.refused(&format!("{build} --resume"));
    assert!(message.contains("mesh.ply has changed"), "{message}");
}

#[test]
fn a_full_disk_is_a_clear_error_and_the_build_can_be_resumed() {
    let folder = Folder::new();
    // A limit on file sizes stands for the disk. Its signal is ignored, so writing fails as on a full disk.
    let limited = |words: &str, blocks: u32| {
        let command = folder.command(words);
        let mut shell = Command::new("sh");
        shell.current_dir(folder.0.path()).args([
            "-c",
            &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\""),
            "sh",
        ]);
        shell.arg(command.get_program()).args(command.get_args());
        let out = shell.output().expect("the shell starts");
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let build = format!("build SCAN {LITTLE} -o out.lodpack --resume");
    for blocks in [1, 100, 400, 700] {
        let (code, message) = limited(&build, blocks);
        assert_eq!(code, Some(2), "{blocks}: {message}");
        assert!(message.contains("out.lodpack") && !message.contains("panicked"), "{message}");
        assert!(!folder.path("out.lodpack").exists());
    }
    folder.ok(&build);
    assert!(folder.built("out.lodpack"));

    folder.ok("plan SCAN -o job --parts 1");
    let (code, message) = limited("build --job job --part 0", 100);
    assert_eq!(code, Some(2), "{message}");
    assert!(message.contains("part-0.lodpart"), "{message}");
    assert!(folder.ok("build --job job --part 0").contains("part-0"));
    let message = folder.refused("merge job -o /dev/full --force");
    assert!(message.contains("No space left"), "{message}");
    folder.ok("merge job -o again.lodpack");
    assert!(folder.built("again.lodpack"));
}

#[test]
fn paths_that_cannot_be_written_are_named() {
    let folder = Folder::new();
    // Not even root can make a directory there.
    for words in ["plan SCAN -o /proc/job", "build SCAN --memory 26MiB --temp /proc -o out.lodpack"] {
        let message = folder.refused(words);
        assert!(message.contains("/proc/") && message.contains("cannot be made"), "{message}");
    }
    fs::write(folder.path("file"), "").expect("written");
    fs::create_dir(folder.path("folder")).expect("made");
    fs::write(folder.path("folder/thesis.tex"), "").expect("written");
    for (words, word) in [
        ("plan SCAN -o file", "is a file"),
        ("plan SCAN -o folder", "thesis.tex"),
        ("plan SCAN -o folder --force", "thesis.tex"),
        ("plan SCAN -o no/job", "there is no directory"),
        ("atlas SCAN -o no/atlas", "there is no directory"),
        ("build folder -o out.lodpack", "the folder has no meshes"),
        ("merge nowhere -o out.lodpack", "does not exist"),
    ] {
        let words = words.replace("atlas SCAN", &format!("atlas {}", scan().display()));
        let message = folder.refused(&words);
        assert!(message.contains(word), "{words}: {message}");
    }
    assert!(folder.refused("build SCAN -o nowhere/out.lodpack").contains("nowhere"));
    assert!(folder.refused("build --job nowhere --part 0").contains("holds no job"));
    assert!(folder.refused("merge nowhere -o out.lodpack").contains("nowhere"));
    assert!(folder.refused("status nowhere").contains("holds no job"));
}

#[test]
fn a_dry_run_shows_what_would_be_submitted() {
    let folder = Folder::new();
    folder.ok("plan SCAN -o job --parts 5");
    folder.ok("build --job job --part 3");
    let text = folder.ok("submit --engine slurm job -o out.lodpack --dry-run");
    assert!(text.contains("#SBATCH --array=0-2,4\n") && text.contains("--dependency=afterok:"), "{text}");
    assert!(!text.contains('@'), "a placeholder is not filled in: {text}");
    assert!(!folder.path("job/slurm").exists());
    let json = folder.ok("submit --engine slurm job -o out.lodpack --dry-run --json");
    let scripts: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert!(scripts["parts"].as_str().is_some_and(|text| text.contains("#SBATCH --array=0-2,4\n")), "{json}");
    assert!(folder.refused("submit --engine slurm job -o no/dir/x --dry-run").contains("there is no directory"));
}

fn recipe(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("engines").join(name)
}

/// Runs a recipe, if the programs that it needs are installed.
fn run_recipe(folder: &Folder, needs: &[&str], mut command: Command) {
    let is_there = Command::new(needs[0]).args(&needs[1..]).output().is_ok_and(|out| out.status.success());
    if !is_there {
        assert!(std::env::var_os("LODPACK_REQUIRE_ENGINES").is_none(), "{needs:?} fails");
        println!("skipped: {needs:?} fails");
        return;
    }
    command.current_dir(folder.0.path()).env("LODPACK", env!("CARGO_BIN_EXE_lodpack"));
    let out = command.output().expect("it starts");
    assert!(out.status.success(), "{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    let whole = folder.path("whole.lodpack");
    lodpack().arg("build").arg(scan()).arg("-o").arg(&whole).assert().success();
    assert!(fs::read(folder.path("out.lodpack")).expect("merged") == fs::read(whole).expect("built"));
}

#[test]
fn the_recipe_for_gnu_parallel_works() {
    let folder = Folder::new();
    let mut command = Command::new(recipe("parallel/build.sh"));
    command.arg(scan()).args(["out.lodpack", "3", "--jobs", "2"]);
    run_recipe(&folder, &["parallel", "--version"], command);
}

#[test]
fn the_recipe_for_dask_works() {
    let folder = Folder::new();
    let mut command = Command::new("python3");
    command.arg(recipe("dask/build.py")).arg(scan()).args(["out.lodpack", "3"]);
    run_recipe(&folder, &["python3", "-c", "import dask"], command);
}

#[test]
fn the_recipe_for_snakemake_works() {
    let folder = Folder::new();
    let mut command = Command::new("snakemake");
    command.arg("--snakefile").arg(recipe("snakemake/Snakefile")).args(["--cores", "2", "--config"]);
    command.arg(format!("mesh={}", scan().display())).args(["out=out.lodpack", "workers=3"]);
    run_recipe(&folder, &["snakemake", "--version"], command);
}
