//! Disks that are full and folders that may not be written to.

use crate::operations::Operation;
use crate::world::{Content, assert_failed, content, names, program, run, wrapped};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small disk in memory, where this process may mount one.
struct Disk(PathBuf);

impl Disk {
    fn mounted(at: &Path, kib: usize) -> Option<Self> {
        let size = format!("size={kib}k");
        mount(&["-t", "tmpfs", "-o", &size, "tmpfs"], at).then(|| Self(at.into()))
    }

    fn made_read_only(&self) {
        assert!(mount(&["-o", "remount,ro"], &self.0));
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).output();
    }
}

fn mount(options: &[&str], at: &Path) -> bool {
    let output = Command::new("mount").args(options).arg(at).output();
    output.is_ok_and(|output| output.status.success())
}

#[test]
fn files_that_may_not_grow_are_an_error_and_leave_nothing() {
    for operation in Operation::all() {
        let folder = operation.folder.path();
        let inputs = operation.inputs();
        // one block a file; without the signal, which would end the program before it can clean up
        let script = "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"".to_owned();
        let program = program().to_string_lossy().into_owned();
        let arguments: Vec<String> = ["-c".to_owned(), script, program]
            .into_iter()
            .chain(operation.line(0).iter().cloned())
            .collect();
        let output = wrapped(OsString::from("sh"), folder, &arguments)
            .output()
            .unwrap();
        assert_failed(&output, operation.line(0));
        assert!(
            operation.inputs() == inputs,
            "{}: an input changed",
            operation.name
        );
        if operation.is_catalogue() {
            operation.assert_whole(&Content::new(), 0);
        } else {
            assert_eq!(names(&operation.out()), [""; 0], "{}", operation.name);
        }
    }
}

#[test]
fn a_full_disk_is_an_error_and_leaves_the_old_output() {
    for operation in Operation::all() {
        let folder = operation.folder.path();
        // a disk for the old output, that is then filled
        let Some(_disk) = Disk::mounted(&operation.out(), 8192) else {
            println!("SKIPPED: this user may not mount a small disk");
            return;
        };
        crate::world::succeed(folder, operation.line(0));
        let (before, inputs) = (content(&operation.output()), operation.inputs());
        let filler = operation.out().join("filler");
        fill(&filler);
        if operation.is_catalogue() {
            // more photos than there is room for
            for number in 0..50 {
                fs::write(
                    folder.join(format!("in/photos/more{number}.bmp")),
                    crate::world::photo(700 + number, 40, 30),
                )
                .unwrap();
            }
            let output = run(folder, operation.line(1));
            assert_failed(&output, operation.line(1));
            operation.assert_whole(&before, 1);
            continue;
        }
        let output = run(folder, operation.line(1));
        assert_failed(&output, operation.line(1));
        assert!(
            content(&operation.output()) == before,
            "{}: the old output is gone",
            operation.name
        );
        assert!(
            operation.inputs() == inputs,
            "{}: an input changed",
            operation.name
        );
        let left = names(&operation.out());
        assert_eq!(left.len(), 2, "{}: {left:?}", operation.name);
    }
}

/// Writes until the disk has no room for a page more.
fn fill(path: &Path) {
    use std::io::Write as _;
    let mut file = fs::File::create(path).unwrap();
    while file.write_all(&[0; 4096]).is_ok() {}
}

#[test]
fn a_folder_that_may_not_be_written_to_is_an_error() {
    for operation in Operation::all() {
        let folder = operation.folder.path();
        let disk = Disk::mounted(&operation.out(), 1024);
        match &disk {
            Some(disk) => disk.made_read_only(),
            None => allow_writing(&operation.out(), false),
        }
        if fs::write(operation.out().join("probe"), "a").is_ok() {
            println!("SKIPPED: this user may write everywhere, but not mount");
            return;
        }
        let inputs = operation.inputs();
        let output = run(folder, operation.line(0));
        if disk.is_none() {
            allow_writing(&operation.out(), true);
        }
        assert_failed(&output, operation.line(0));
        assert_eq!(names(&operation.out()), [""; 0], "{}", operation.name);
        assert!(
            operation.inputs() == inputs,
            "{}: an input changed",
            operation.name
        );
    }
}

fn allow_writing(folder: &Path, allowed: bool) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = if allowed { 0o755 } else { 0o555 };
        fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
    }
    #[cfg(not(unix))]
    let _ = (folder, allowed);
}
