//! A real Slurm of three nodes on this machine: parts as an array, a task that fails, a node that dies, a merge that
//! waits.

use crate::commands::lodpack;
use crate::jobs::{REGION, expected};
use crate::scan;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The longest wait for anything that Slurm does: it looks for work every few seconds.
const LONGEST_WAIT: Duration = Duration::from_secs(240);

/// A running Slurm, stopped when dropped.
struct Slurm {
    dir: tempfile::TempDir,
    conf: PathBuf,
    _alone: MutexGuard<'static, ()>,
}

static ALONE: Mutex<()> = Mutex::new(());

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/slurm").join(name)
}

impl Slurm {
    /// Starts Slurm, or says that its test is skipped; that fails where Slurm is required.
    fn start_or_skip() -> Option<Self> {
        let slurm = Self::start();
        if slurm.is_none() {
            assert!(std::env::var_os("LODPACK_REQUIRE_SLURM").is_none(), "Slurm is not installed");
            println!("skipped: no Slurm (munge, slurmctld, slurmd, slurm-client)");
        }
        slurm
    }

    /// Writes a program into its folder that stands for lodpack.
    fn write_program(&self, name: &str, text: &str) {
        let (dir, path) = (self.dir.path(), self.dir.path().join(name));
        // With a slash at its end.
        let folder = dir.join("");
        let text = text.replace("@DIR@", folder.to_str().expect("UTF-8"));
        fs::write(&path, text.replace("@LODPACK@", env!("CARGO_BIN_EXE_lodpack"))).expect("written");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("executable");
    }

    /// None if Slurm is not installed, or if this is not root.
    fn start() -> Option<Self> {
        // The nodes of a second one would have the same ports.
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let is_there =
            |program: &str| Command::new("which").arg(program).output().is_ok_and(|out| out.status.success());
        if !["munged", "slurmctld", "slurmd", "sbatch"].iter().all(|program| is_there(program)) {
            return None;
        }
        let dir = tempfile::tempdir().expect("a temporary directory");
        let out = Command::new(script("up.sh")).arg(dir.path()).output().expect("the script starts");
        let slurm = Self { conf: dir.path().join("slurm.conf"), dir, _alone: alone };
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        Some(slurm)
    }

    fn run(&self, program: &str, arguments: &[&str]) -> String {
        let out = Command::new(program).args(arguments).env("SLURM_CONF", &self.conf).output().expect("it starts");
        String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr)
    }

    /// The state of a task of an array, or of a job.
    fn state(&self, job: &str) -> String {
        self.run("scontrol", &["show", "job", job])
    }

    /// Kills everything on a node at once, first whatever would report the end of the task whose process a file names.
    fn kill_node_n2(&self, hung: &str) {
        let daemon = self.dir.path().join("slurmd-n2.pid");
        let node = format!(
            "task=$(cat {hung}); step=$(ps -o ppid= -p $task); kill -9 $(cat {}) $step $task $(pgrep -P $task)",
            daemon.display()
        );
        self.run("sh", &["-c", &node]);
    }

    fn wait(&self, what: &str, mut is_so: impl FnMut() -> bool) {
        let start = Instant::now();
        while !is_so() {
            assert!(start.elapsed() < LONGEST_WAIT, "{what} does not come: {}", self.run("squeue", &["-a"]));
            std::thread::sleep(Duration::from_millis(300));
        }
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        let _ = Command::new(script("down.sh")).arg(self.dir.path()).status();
    }
}

/// Stands in for the program on the nodes: part 2 fails once, and the first task on node n2 hangs until the node is
/// killed.
const UNLUCKY: &str = r#"#!/bin/sh
case "$*" in
  *"--part 2-2"*) if mkdir @DIR@/failed-once 2> /dev/null; then echo "an unlucky task" >&2; exit 1; fi ;;
esac
if [ "${SLURMD_NODENAME:-}" = n2 ] && mkdir @DIR@/hung-once 2> /dev/null; then
  echo $$ > @DIR@/hung
  sleep 600
fi
exec @LODPACK@ "$@"
"#;

#[test]
fn an_array_survives_a_failed_task_and_a_killed_node() {
    let Some(slurm) = Slurm::start_or_skip() else { return };
    let dir = slurm.dir.path();
    let path = |name: &str| dir.join(name).to_str().expect("UTF-8").to_owned();
    slurm.write_program("unlucky", UNLUCKY);

    let (job, out) = (path("job"), path("scan.lodpack"));
    let scan = scan();
    let scan = scan.to_str().expect("UTF-8");
    lodpack().args(["plan", scan, "-o", &job, "--parts", "7", "--region-triangles", REGION]).assert().success();
    let submit = || {
        let arguments =
            ["submit", "--engine", "slurm", &job, "-o", &out, "--threads", "1", "--program", &path("unlucky")];
        let done = lodpack().args(arguments).arg("--json").env("SLURM_CONF", &slurm.conf).output().expect("it starts");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        serde_json::from_slice::<serde_json::Value>(&done.stdout).expect("JSON")
    };
    let submitted = submit();
    let (parts, merge) =
        (submitted["parts"].as_str().expect("a number"), submitted["merge"].as_str().expect("a number"));

    // The node dies with a task on it; Slurm then runs the task again on another node.
    let hung = path("hung");
    slurm.wait("a task on node n2", || fs::read_to_string(&hung).is_ok_and(|pid| pid.ends_with('\n')));
    slurm.kill_node_n2(&hung);
    let done = || lodpack_cli::job::JobStatus::of(Path::new(&job)).expect("a job").done();
    slurm.wait("all parts but the unlucky one", || {
        // On its own, Slurm would wait two minutes before it runs a task again whose node died.
        slurm.run("scontrol", &["update", &format!("JobId={parts}"), "StartTime=now"]);
        done() == 6
    });
    slurm.wait("the end of the unlucky task", || slurm.state(&format!("{parts}_2")).contains("JobState=FAILED"));
    assert!(slurm.state(merge).contains("JobState=PENDING"), "the merge waits: {}", slurm.state(merge));
    assert!(!Path::new(&out).exists());

    let again = submit();
    let (rest, merge) = (again["parts"].as_str().expect("a number"), again["merge"].as_str().expect("a number"));
    slurm.wait("the merge", || slurm.state(merge).contains("JobState=COMPLETED"));
    assert!(fs::read(&out).expect("merged") == expected(), "the bytes differ");
    let log = |name: &str| fs::read_to_string(dir.join("job/slurm").join(name)).unwrap_or_default();
    let all: String = (0..7).map(|part| log(&format!("parts-{part}.log"))).collect();
    assert!(all.contains("try 2"), "no task was run again after the node died: {all}");
    assert!(log("parts-2.log").contains("an unlucky task") && log("merge.log").contains("merge on"), "{all}");
    for node in ["n1", "n2", "n3"] {
        assert!(all.contains(&format!("node {node}")), "nothing ran on {node}: {all}");
    }
    assert!(slurm.state(rest).contains("ArrayTaskId=2"), "{}", slurm.state(rest));
}

/// Stands in for the program on the nodes: the first task of the stage that sends triangles to regions hangs on node n2
/// until the node is killed.
const DYING: &str = r#"#!/bin/sh
case "$*" in
  *"--stage divide "*)
    if [ "${SLURMD_NODENAME:-}" = n2 ] && mkdir @DIR@/hung-once 2> /dev/null; then
      echo $$ > @DIR@/hung
      sleep 600
    fi ;;
esac
exec @LODPACK@ "$@"
"#;

#[test]
fn all_stages_run_on_three_nodes_of_which_one_dies_while_triangles_are_divided() {
    let Some(slurm) = Slurm::start_or_skip() else { return };
    let dir = slurm.dir.path();
    let path = |name: &str| dir.join(name).to_str().expect("UTF-8").to_owned();
    slurm.write_program("dying", DYING);

    let (job, out, scan) = (path("job"), path("scan.lodpack"), scan());
    let plan = ["plan", scan.to_str().expect("UTF-8"), "-o", &job, "--parts", "7", "--region-triangles", REGION];
    lodpack().args(plan).args(["--stages", "--range-bytes", "200kB"]).assert().success();
    let submit = || {
        let arguments = ["submit", &job, "-o", &out, "--threads", "1", "--program", &path("dying"), "--json"];
        let done = lodpack().args(arguments).env("SLURM_CONF", &slurm.conf).output().expect("it starts");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        serde_json::from_slice::<serde_json::Value>(&done.stdout).expect("JSON")
    };
    let first = submit();
    // Submitted twice: what waits is replaced, and what runs is waited for.
    let second = submit();
    let waiting = first["merge"].as_str().expect("a number");
    slurm.wait("the end of the first merge", || slurm.state(waiting).contains("JobState=CANCELLED"));
    let stages: Vec<(String, String)> = serde_json::from_value(second["stages"].clone()).expect("stages");
    let divide = &stages.iter().find(|(stage, _)| stage == "divide").expect("it was not done yet").1;

    let hung = path("hung");
    slurm.wait("a task on node n2", || fs::read_to_string(&hung).is_ok_and(|pid| pid.ends_with('\n')));
    slurm.kill_node_n2(&hung);
    let done = || {
        let status = lodpack_cli::job::JobStatus::of(Path::new(&job)).expect("a job");
        status.stages.iter().filter(|stage| stage.done == stage.tasks).count()
    };
    slurm.wait("the stages until the shuffle", || {
        slurm.run("scontrol", &["update", &format!("JobId={divide}"), "StartTime=now"]);
        done() >= 4
    });
    let merge = second["merge"].as_str().expect("a number");
    slurm.wait("the merge", || slurm.state(merge).contains("JobState=COMPLETED"));
    assert!(fs::read(&out).expect("merged") == expected(), "the bytes differ");
    let log = |name: &str| fs::read_to_string(dir.join("job/slurm").join(name)).unwrap_or_default();
    let all: String = (0..7).map(|task| log(&format!("divide-{task}.log"))).collect();
    assert!(all.contains("try 2"), "no task was run again after the node died: {all}");
}
