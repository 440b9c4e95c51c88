//! Arguments of `serve`.

use clap::Args;
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;

/// Arguments of `serve`.
#[derive(Args, Debug)]
pub struct ServeArgs {
    /// The files.
    #[arg(value_name = "FILE", required_unless_present = "check")]
    pub files: Vec<PathBuf>,
    /// The port; 0 lets the system choose. By default 8080, or any other if that is in use.
    #[arg(long, value_name = "N")]
    pub port: Option<u16>,
    /// The address to listen at: 0.0.0.0 (or ::) is reachable from other machines.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub bind: IpAddr,
    /// Let pages of other hosts read the files, by headers of CORS and of private networks.
    #[arg(long)]
    pub cors: bool,
    /// Open the page in a browser.
    #[arg(long)]
    pub open: bool,
    /// The viewer page, as `viewer-min/web/pack DIR` makes it, in place of the program's own.
    #[arg(long, value_name = "DIR")]
    pub page: Option<PathBuf>,
    /// Serve nothing: tell whether another server ignores ranges, compresses, lacks CORS headers, or changes the file.
    #[arg(long, value_name = "URL", conflicts_with_all = ["files", "port", "bind", "cors", "open", "page"])]
    pub check: Option<String>,
    /// Print the addresses, or what --check finds, as JSON.
    #[arg(long)]
    pub json: bool,
}
