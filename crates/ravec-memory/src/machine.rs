//! Memory of the machine, as far as this process may use it.

use std::sync::OnceLock;
use sysinfo::{MemoryRefreshKind, ProcessRefreshKind, ProcessesToUpdate, System};

/// Memory assumed where the system does not report any.
const FALLBACK_BYTES: u64 = 4 << 30;

/// Physical memory in bytes, or the limit of the control group of this process where that is lower.
///
/// Read once; 4 GiB where the system does not report any.
pub fn machine_bytes() -> u64 {
    static BYTES: OnceLock<u64> = OnceLock::new();
    *BYTES.get_or_init(read_machine_bytes)
}

fn read_machine_bytes() -> u64 {
    let Ok(mut system) = System::new() else {
        return FALLBACK_BYTES;
    };
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    let physical = system.total_memory();
    let group = sysinfo::get_current_pid().ok().and_then(|pid| {
        let this = ProcessesToUpdate::Some(&[pid]);
        system.refresh_processes_specifics(this, false, ProcessRefreshKind::nothing());
        Some(system.process(pid)?.cgroup_limits()?.total_memory)
    });
    let known = [Some(physical), group].into_iter().flatten();
    known
        .filter(|&bytes| bytes > 0)
        .min()
        .unwrap_or(FALLBACK_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_machine_has_no_more_memory_than_the_kernel_reports() {
        let table = std::fs::read_to_string("/proc/meminfo").unwrap();
        let total = table.lines().find(|line| line.starts_with("MemTotal:"));
        let digits: String = total
            .unwrap()
            .chars()
            .filter(char::is_ascii_digit)
            .collect();
        let total_bytes = digits.parse::<u64>().unwrap() * 1024;
        let bytes = machine_bytes();
        assert!(bytes <= total_bytes && bytes >= 64 << 20, "{bytes}");
    }
}
