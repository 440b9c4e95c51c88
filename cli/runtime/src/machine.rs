//! What the operating system says of this process: the processor time and the memory that it has used.

use std::time::Duration;

/// Has blocks of more than a mebibyte go back to the system when they are freed. The library of the system would keep
/// those of up to 32 once it has seen some, between small ones that are still in use: a third more memory where maps of
/// textures are baked.
#[expect(unsafe_code, reason = "the standard library has no say in this")]
pub fn return_large_blocks() {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt has no conditions, and an allocator may be told at any time.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 20);
    }
}

/// Gives memory back to the system that is free, but lies between blocks that are in use, such as the names of a
/// million objects. It takes milliseconds, so it is for the ends of long steps.
#[expect(unsafe_code, reason = "the standard library has no say in this")]
pub fn return_free_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: malloc_trim has no conditions, and leaves all that is in use where it is.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Processor time that this process has used so far, all threads together.
pub fn process_cpu_time() -> Duration {
    clock(libc::CLOCK_PROCESS_CPUTIME_ID)
}

/// Processor time that the calling thread has used so far.
pub fn thread_cpu_time() -> Duration {
    clock(libc::CLOCK_THREAD_CPUTIME_ID)
}

#[expect(unsafe_code, reason = "the standard library has no processor clocks")]
fn clock(id: libc::clockid_t) -> Duration {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, exclusively borrowed timespec for the duration of the call; on failure it stays zero.
    unsafe { libc::clock_gettime(id, &mut time) };
    Duration::new(time.tv_sec.max(0) as u64, time.tv_nsec.clamp(0, 999_999_999) as u32)
}

/// A memory figure of a process in bytes, as Linux names it: "VmHWM" is the peak of its resident memory, "VmRSS" the
/// present value.
pub fn status_bytes(process: &str, what: &str) -> Option<u64> {
    proc_bytes(&format!("/proc/{process}/status"), what)
}

/// A memory figure in bytes, by its name in a file of Linux that has a line for each.
pub(crate) fn proc_bytes(path: &str, what: &str) -> Option<u64> {
    let lines = std::fs::read_to_string(path).ok()?;
    let value = lines.lines().find_map(|line| line.strip_prefix(what)?.strip_prefix(':'))?;
    value.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The peak of this process's resident memory in bytes; 0 where the system does not report it.
pub fn peak_memory_bytes() -> u64 {
    // On Linux getrusage also counts the process that started this one, where that was larger.
    status_bytes("self", "VmHWM").unwrap_or_else(resource_peak_bytes)
}

#[expect(unsafe_code, reason = "the standard library does not report memory")]
fn resource_peak_bytes() -> u64 {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: getrusage fills the struct that it is given; zeroed is a valid value of this plain C struct if it fails.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_SELF, usage.as_mut_ptr());
        usage.assume_init()
    };
    // Linux reports KiB, macOS bytes.
    usage.ru_maxrss.max(0) as u64 * if cfg!(target_os = "macos") { 1 } else { 1024 }
}
