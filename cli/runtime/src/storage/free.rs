//! How much memory is free for this process: of the machine, of the control groups that it is in, and within its own
//! limits.

use crate::machine::{proc_bytes, status_bytes};
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// What a command takes where nobody says how much: half of what is free when it begins.
pub fn default_memory() -> u64 {
    free_bytes() / 2
}

/// Memory that this process could still take; [`u64::MAX`] where the system does not say.
pub fn free_bytes() -> u64 {
    let groups = read_to_string("/proc/self/cgroup").unwrap_or_default();
    let of_groups = group_limits(&groups, Path::new("/sys/fs/cgroup"));
    of_machine().into_iter().chain(of_groups).chain(own_limits()).min().unwrap_or(u64::MAX)
}

/// What the machine has free, or all that it has where it does not say.
#[expect(unsafe_code, reason = "the standard library does not report memory")]
fn of_machine() -> Option<u64> {
    if let Some(available) = proc_bytes("/proc/meminfo", "MemAvailable") {
        return Some(available);
    }
    // SAFETY: sysconf has no conditions; it returns -1 for what it does not know.
    let (pages, page_bytes) = unsafe { (libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)) };
    (pages > 0 && page_bytes > 0).then(|| pages as u64 * page_bytes as u64)
}

/// What is free in each control group of this process, of version 1 and 2, whose limits hold for all below them.
/// `groups` is /proc/self/cgroup, and `mounted` where their files are.
fn group_limits(groups: &str, mounted: &Path) -> Vec<u64> {
    let mut free = vec![];
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { continue };
        let (folder, names, cache) = match controllers {
            "" => (mounted.to_owned(), ["memory.max", "memory.current"], "inactive_file "),
            _ if controllers.split(',').any(|controller| controller == "memory") => {
                let names = ["memory.limit_in_bytes", "memory.usage_in_bytes"];
                (mounted.join("memory"), names, "total_inactive_file ")
            }
            _ => continue,
        };
        // Within a container the path may be that of the host, of which only the top is there.
        for above in Path::new(path.trim_start_matches('/')).ancestors() {
            free.extend(free_of_group(folder.join(above), names, cache));
        }
    }
    free
}

/// What is free in a control group; nothing if it has no limit.
fn free_of_group(group: PathBuf, [limit, used]: [&str; 2], cache: &str) -> Option<u64> {
    let number = |name: &str| read_to_string(group.join(name)).ok()?.trim().parse::<u64>().ok();
    let limit = number(limit)?;
    // What the group caches of files goes when somebody needs memory.
    let stat = read_to_string(group.join("memory.stat")).unwrap_or_default();
    let cached = stat.lines().find_map(|line| line.strip_prefix(cache)?.trim().parse::<u64>().ok());
    let used = number(used).unwrap_or(0).saturating_sub(cached.unwrap_or(0));
    Some(limit.saturating_sub(used))
}

/// What the limits of this process leave: of addresses and of data.
#[expect(unsafe_code, reason = "the standard library does not report limits")]
fn own_limits() -> impl Iterator<Item = u64> {
    [(libc::RLIMIT_AS, "VmSize"), (libc::RLIMIT_DATA, "VmData")].into_iter().filter_map(|(what, name)| {
        let mut limit = libc::rlimit { rlim_cur: libc::RLIM_INFINITY, rlim_max: libc::RLIM_INFINITY };
        // SAFETY: getrlimit fills the struct that it is given, which is borrowed exclusively during the call.
        let is_known = unsafe { libc::getrlimit(what, &raw mut limit) } == 0;
        let is_limited = is_known && limit.rlim_cur != libc::RLIM_INFINITY;
        // Where the system does not say what is used, it is little beside any limit.
        is_limited.then(|| limit.rlim_cur.saturating_sub(status_bytes("self", name).unwrap_or(0)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_groups_and_of_those_above_them_count() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let put = |path: &str, text: &str| {
            let path = dir.path().join(path);
            std::fs::create_dir_all(path.parent().expect("it has one")).expect("writable");
            std::fs::write(path, text).expect("writable");
        };
        put("a/b/memory.max", "max\n");
        put("a/memory.max", "1000\n");
        put("a/memory.current", "700\n");
        put("a/memory.stat", "anon 5\ninactive_file 300\n");
        put("memory/x/memory.limit_in_bytes", "500\n");
        put("memory/x/memory.usage_in_bytes", "600\n");
        let mut free = group_limits("5:cpu,memory:/x\n4:cpuset:/\n0::/a/b\nnonsense\n", dir.path());
        free.sort_unstable();
        assert_eq!(free, [0, 600]);
        assert!(group_limits("0::/../host/path\n", &dir.path().join("none")).is_empty());
    }

    #[test]
    fn something_is_free_and_not_more_than_there_is() {
        assert!((1 << 20..=u64::MAX / 2).contains(&free_bytes()));
    }
}
