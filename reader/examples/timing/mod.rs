//! How long calls take, for benches.

use std::time::Instant;

use lodpack::Result;

/// Processor seconds of one call, which is repeated until `least` seconds have been spent.
pub fn seconds(least: f64, call: impl Fn() -> Result<usize>) -> Result<f64> {
    call()?;
    let (start, mut count) = (now(), 0);
    loop {
        std::hint::black_box(call()?);
        count += 1;
        let passed = now() - start;
        if passed > least {
            return Ok(passed / f64::from(count));
        }
    }
}

/// Processor time of this thread, or elapsed time.
fn now() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let used: Option<f64> = text.split(' ').next().and_then(|nanoseconds| nanoseconds.parse().ok());
    used.map_or_else(|| START.get_or_init(Instant::now).elapsed().as_secs_f64(), |nanoseconds| nanoseconds * 1e-9)
}
