//! nginx on loopback, which is what many files will be served by.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A running server, which ends with the value.
#[derive(Debug)]
pub struct Nginx {
    child: Child,
    log: PathBuf,
    /// Address of the folder that it serves, without a slash at the end.
    pub url: String,
}

/// An answer that nginx has sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Which file was asked for, from the slash on.
    pub path: String,
    /// 206 for a range.
    pub status: u16,
    /// Bytes of the body.
    pub bytes: u64,
}

impl Nginx {
    /// Serves a folder; writes its configuration and log into `work`, which is another one. Returns `None` where nginx
    /// is not installed.
    ///
    /// # Panics
    ///
    /// If it is installed and does not start.
    #[must_use]
    pub fn start(folder: &Path, work: &Path) -> Option<Self> {
        // Debian installs it where only an administrator's shell looks.
        let works = |program: &&str| Command::new(program).arg("-v").output().is_ok_and(|out| out.status.success());
        let program = ["nginx", "/usr/sbin/nginx"].into_iter().find(works)?;
        let port = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).expect("a free port").port();
        let (log, configuration) = (work.join("access.log"), work.join("nginx.conf"));
        let temporary = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|kind| format!("{kind}_temp_path {};", work.join(kind).display()))
            .concat();
        // Without a master process it runs as whoever runs the test, and ends when it is told to.
        let text = format!(
            "daemon off; master_process off; pid {work}/pid; error_log {work}/error.log; events {{}}\n\
             http {{ {temporary} log_format sent '$status $body_bytes_sent $uri'; access_log {log} sent;\n\
             server {{ listen 127.0.0.1:{port}; root {folder}; }} }}\n",
            work = work.display(),
            log = log.display(),
            folder = folder.display(),
        );
        std::fs::write(&configuration, text).expect("a writable folder");
        let child =
            Command::new(program).arg("-c").arg(&configuration).arg("-p").arg(work).stderr(Stdio::null()).spawn();
        let nginx = Self { child: child.expect("it starts"), log, url: format!("http://127.0.0.1:{port}") };
        for _ in 0..200 {
            if TcpStream::connect(("127.0.0.1", port)).is_ok() {
                return Some(nginx);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        let complaint = std::fs::read_to_string(work.join("error.log")).unwrap_or_default();
        panic!("nginx does not answer: {complaint}");
    }

    /// What it has answered so far.
    ///
    /// # Panics
    ///
    /// If the log is not as configured.
    #[must_use]
    pub fn answers(&self) -> Vec<Answer> {
        let log = std::fs::read_to_string(&self.log).unwrap_or_default();
        let answer = |line: &str| {
            let mut words = line.splitn(3, ' ');
            let (status, bytes) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
            Some(Answer { path: words.next()?.to_owned(), status, bytes })
        };
        log.lines().map(|line| answer(line).expect("a status, a number of bytes and a path")).collect()
    }
}

impl Drop for Nginx {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
