//! The program `ravec`.

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    set_allocator(std::env::args_os().any(|argument| is_clip_command(&argument)));
    ravec_cli::run(std::env::args_os()).into()
}

/// Commands that work on one frame of a clip after the other, and need buffers of the same sizes again for each.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const CLIP_COMMANDS: [&str; 5] = ["matte", "plate", "stabilize", "track", "video"];

/// Returns `true` for the name of a command on clips. A file of this name costs memory and nothing else.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn is_clip_command(argument: &std::ffi::OsStr) -> bool {
    CLIP_COMMANDS.iter().any(|name| argument == *name)
}

/// Lets what buffers from 2 MiB on took go back to the system as soon as they are dropped, and keeps 4 MiB of free memory for smaller
/// ones in each heap; commands on clips keep the memory of buffers up to 32 MiB.
///
/// Otherwise the C library returns large buffers until one of up to 32 MiB is dropped: from then on it keeps such buffers in its
/// heaps, where smaller ones lie between them. Offsets of a million triangles took 630 MB so, of which 430 were in use. From 16 MiB on
/// they took up to a quarter more than from 2 MiB on, which costs a hundredth to a thirtieth of the time. Without free memory in the
/// heaps, a sixth of the time of a mosaic goes into getting the pages of one photo after the other again. Frames of clips are another
/// case: to get their pages again for each frame takes a quarter of the time.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(
    unsafe_code,
    reason = "the settings of the C library have no safe interface"
)]
fn set_allocator(has_clips: bool) {
    const LARGE: libc::c_int = 2 << 20;
    const FREE: libc::c_int = 4 << 20;
    const LARGEST: libc::c_int = 32 << 20;
    const KEPT: libc::c_int = 256 << 20;
    // SAFETY: it takes two numbers, and may be called at any time; where it refuses, all stays as it is.
    unsafe {
        if has_clips {
            libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST);
            libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT);
        } else {
            libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
            libc::mallopt(libc::M_TRIM_THRESHOLD, FREE);
        }
    }
}
