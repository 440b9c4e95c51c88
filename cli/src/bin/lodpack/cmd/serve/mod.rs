//! `lodpack serve`

mod browser;
mod page;

use super::open::open_any;
use super::print_json;
use crate::args::ServeArgs;
use crate::interrupt;
use crate::messages;
use crate::output::say;
use anyhow::{Context, Result, bail};
use lodpack_cli::serve::{Server, Shelf, Verdict, check, escape};
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

/// The port where none is asked for, if it is free.
const PORT: u16 = 8080;

/// Where a file is served.
#[derive(Serialize)]
struct Served {
    file: String,
    /// The address of its bytes.
    address: String,
    /// The address of a page that shows it, if there is one.
    page: Option<String>,
}

/// Serves files until it is stopped, or checks another server.
pub fn run(args: &ServeArgs) -> Result<ExitCode> {
    if let Some(url) = &args.check {
        return check_server(url, args.json);
    }
    interrupt::on_stop_end();
    let page = page::load(args.page.as_deref())?;
    let mut shelf = Shelf::new(|file| {
        let text = "has changed; who has it open is told so with the next request, and has to open it again";
        messages::tell("note", &format!("{} {text}", file.display()));
    });
    for (path, item) in page.items {
        shelf.put(path, item);
    }
    // One that is wrong does not stop the others.
    let (mut files, mut paths, mut failed) = (vec![], vec![], None);
    for file in &args.files {
        match put(&mut shelf, file) {
            Ok(path) => {
                files.push(file);
                paths.push(path);
            }
            Err(error) if args.files.len() == 1 => return Err(error),
            Err(error) => {
                messages::tell("warning", &format!("{error:#}; it is not served"));
                failed = Some(error);
            }
        }
    }
    if let Some(error) = failed.filter(|_| files.is_empty()) {
        return Err(error.context("none of the files can be served"));
    }
    let server = listen(args)?;
    let here = server.address().context("cannot tell the server's address")?;
    let host = format!("http://{}", reachable(here));
    let mut served = vec![];
    for (file, path) in files.iter().zip(&paths) {
        let address = format!("{host}{}", escape(path));
        let view = format!("/?url={}", escape(path));
        if page.is_there {
            shelf.show_at(path, view.clone());
        }
        let page = page.is_there.then(|| format!("{host}{view}"));
        served.push(Served { file: file.display().to_string(), address, page });
    }
    if paths.len() != 1 || !page.is_there {
        shelf.set_front(list(&paths, page.is_there));
    }
    announce(&served, args.json)?;
    if !page.is_there {
        messages::tell("note", page::MISSING);
    }
    if here.ip().is_unspecified() {
        messages::tell("note", "other machines reach it by this machine's name or address");
    }
    messages::tell("note", "Ctrl-C stops the server");
    if args.open
        && let Some(Served { address, page, .. }) = served.first()
    {
        browser::open(if served.len() == 1 { page.as_ref().unwrap_or(address) } else { &host });
    }
    server.run(&Arc::new(shelf)).context("cannot wait for connections")?;
    Ok(ExitCode::SUCCESS)
}

/// Puts a file on the shelf, if it is a lodpack file.
fn put(shelf: &mut Shelf, file: &Path) -> Result<String> {
    if file.to_str().is_some_and(|name| name.contains("://")) {
        bail!(
            "{}: only files of this machine can be served; --check tells what is wrong with another server",
            file.display()
        );
    }
    // Whoever serves a wrong file should hear of it here, not in a browser.
    drop(open_any(file)?);
    // Relative to where the program was started, even if that is not where it stays.
    let file = std::path::absolute(file).with_context(|| format!("cannot find {}", file.display()))?;
    Ok(shelf.put_file(&file))
}

/// Listens where it is asked to, or where it is free.
fn listen(args: &ServeArgs) -> Result<Server> {
    let bind = |port| Server::bind(SocketAddr::new(args.bind, port), args.cors);
    match (args.port, bind(args.port.unwrap_or(PORT))) {
        (None, Err(error)) if matches!(error.kind(), ErrorKind::AddrInUse | ErrorKind::PermissionDenied) => {
            bind(0).with_context(|| format!("cannot listen at {}", args.bind))
        }
        (Some(port), Err(error)) if error.kind() == ErrorKind::AddrInUse => {
            bail!("port {port} is in use: choose another one with --port, or let the system choose with --port 0")
        }
        (Some(port), Err(error)) if error.kind() == ErrorKind::PermissionDenied => {
            bail!("this user may not use port {port}: choose one above 1023 with --port")
        }
        (_, Err(error)) if error.kind() == ErrorKind::AddrNotAvailable => {
            bail!(
                "{} is no address of this machine; --bind 127.0.0.1 is for this machine alone, --bind 0.0.0.0 for all",
                args.bind
            )
        }
        (_, bound) => bound.with_context(|| format!("cannot listen at {}", args.bind)),
    }
}

/// An address that a browser on this machine can open.
fn reachable(here: SocketAddr) -> SocketAddr {
    let ip = match here.ip() {
        ip if !ip.is_unspecified() => ip,
        IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
    };
    SocketAddr::new(ip, here.port())
}

/// One line a file: what to open.
fn announce(served: &[Served], json: bool) -> Result<()> {
    if json {
        print_json(&served)?;
    } else {
        for Served { address, page, .. } in served {
            say!("{}", page.as_ref().unwrap_or(address));
        }
    }
    // Programs that started this one wait for it. One that has read enough may have closed the pipe: that is no reason
    // to stop.
    let _ = std::io::stdout().flush();
    Ok(())
}

/// A page that lists the files.
fn list(paths: &[String], has_page: bool) -> String {
    let line = |path: &String| {
        let (to, name) = (escape(path), path.trim_start_matches('/'));
        let name = name.replace('&', "&amp;").replace('<', "&lt;");
        let view = if has_page { format!("/?url={to}") } else { to };
        format!("<li><a href=\"{view}\">{name}</a></li>\n")
    };
    let lines: String = paths.iter().map(line).collect();
    format!("<!doctype html>\n<meta charset=\"utf-8\">\n<title>lodpack</title>\n<ul>\n{lines}</ul>\n")
}

/// Says what a server does wrong; exit status 1 if there is anything.
fn check_server(url: &str, json: bool) -> Result<ExitCode> {
    if !["http://", "https://"]
        .iter()
        .any(|scheme| url.get(..scheme.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme)))
    {
        bail!("{url}: --check needs the address of a file on a web server, with http:// or https://");
    }
    let findings = check(url).with_context(|| format!("cannot reach {url}"))?;
    if json {
        print_json(&findings)?;
    } else {
        for finding in &findings {
            let verdict = match finding.verdict {
                Verdict::Ok => "ok",
                Verdict::Note => "note",
                Verdict::Problem => "PROBLEM",
            };
            say!("{verdict:<8} {}", finding.text);
        }
    }
    let is_bad = findings.iter().any(|finding| finding.verdict == Verdict::Problem);
    Ok(if is_bad { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
