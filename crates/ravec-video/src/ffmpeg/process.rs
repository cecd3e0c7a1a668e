//! The programs of FFmpeg as child processes: found, fed, listened to, and ended.
//!
//! A thread reads standard error as it comes and keeps a bounded part, so that a chatty child never blocks. A child ends with
//! its [`Process`], whatever it does at that moment.

use crate::error::VideoError;
use std::collections::VecDeque;
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Protocols that a child may open: files and its own pipes, so that no file makes it reach for the network.
const PROTOCOLS: &str = "file,pipe";
/// Lines of standard error that are kept: the last ones name the reason.
const MAX_LINES: usize = 64;
/// Bytes of a line that are kept.
const MAX_LINE_BYTES: usize = 400;
/// Time after the end of a child in which the rest of its standard error is waited for. Only a child of the child that keeps
/// the pipe open uses it up.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// Time in which a short question, such as for the streams of a file, must be answered.
const ANSWER: Duration = Duration::from_mins(2);

/// The two programs.
#[derive(Debug, Clone)]
pub(super) struct Programs {
    ffmpeg: PathBuf,
    ffprobe: PathBuf,
}

impl Programs {
    /// Finds the programs by `RAVEC_FFMPEG` and `RAVEC_FFPROBE`, or in `PATH`. An `ffprobe` that is not named is looked for
    /// beside `ffmpeg` first.
    pub(super) fn locate(needed_for: &str) -> Result<Self, VideoError> {
        Self::locate_by(needed_for, |variable| std::env::var_os(variable))
    }

    /// The same with other variables than those of the process.
    fn locate_by(
        needed_for: &str,
        variable: impl Fn(&str) -> Option<OsString>,
    ) -> Result<Self, VideoError> {
        let find = |name: &str, program: &str| match variable(name) {
            Some(path) => Some(PathBuf::from(path)).filter(|path| path.is_file()),
            None => in_path(&variable("PATH")?, program),
        };
        let missing = || VideoError::FfmpegMissing {
            needed_for: needed_for.to_owned(),
        };
        let ffmpeg = find("RAVEC_FFMPEG", "ffmpeg").ok_or_else(missing)?;
        let beside = ffmpeg.with_file_name(executable("ffprobe"));
        let ffprobe = if variable("RAVEC_FFPROBE").is_none() && beside.is_file() {
            beside
        } else {
            find("RAVEC_FFPROBE", "ffprobe").ok_or_else(missing)?
        };
        Ok(Self { ffmpeg, ffprobe })
    }

    /// The arguments that keep the time stamps of frames as they are, in the words of this version.
    pub(super) fn passthrough(&self) -> Result<[&'static str; 2], VideoError> {
        Ok(if self.version()? < (5, 1) {
            ["-vsync", "passthrough"]
        } else {
            ["-fps_mode", "passthrough"]
        })
    }

    /// True if this version decodes and filters in threads of their own.
    pub(super) fn is_pipelined(&self) -> Result<bool, VideoError> {
        Ok(self.version()? >= (7, 0))
    }

    /// The numbers of the release. Builds between releases have names such as N-109000-g1a2b3c, and count as newer than all.
    fn version(&self) -> Result<(u32, u32), VideoError> {
        let banner = capture(self.ffmpeg().arg("-version"), 1 << 16)?;
        let text = String::from_utf8_lossy(&banner.stdout);
        let version = text.split_whitespace().nth(2).unwrap_or_default();
        let mut numbers = version
            .split(|c: char| !c.is_ascii_digit())
            .map(str::parse::<u32>);
        Ok(match (numbers.next(), numbers.next()) {
            (Some(Ok(major)), Some(Ok(minor))) => (major, minor),
            (Some(Ok(major)), _) => (major, 0),
            _ => (u32::MAX, 0),
        })
    }

    /// A call of `ffmpeg` that asks nothing and prints errors only.
    pub(super) fn ffmpeg(&self) -> Command {
        let mut command = Command::new(&self.ffmpeg);
        command.args(["-nostdin", "-hide_banner", "-loglevel", "error"]);
        command
    }

    /// A call of `ffprobe` that prints errors only.
    pub(super) fn ffprobe(&self) -> Command {
        let mut command = Command::new(&self.ffprobe);
        command.args(["-hide_banner", "-loglevel", "error"]);
        command
    }
}

fn executable(name: &str) -> String {
    format!("{name}{}", std::env::consts::EXE_SUFFIX)
}

fn in_path(folders: &OsStr, name: &str) -> Option<PathBuf> {
    std::env::split_paths(folders)
        // an empty entry means the current folder, whose programs nobody vouches for
        .filter(|folder| folder.is_absolute())
        .map(|folder| folder.join(executable(name)))
        .find(|path| path.is_file())
}

/// The name of a file as FFmpeg takes it: neither an option nor an address, whatever its characters.
pub(super) fn file_argument(path: &Path) -> Result<OsString, VideoError> {
    let mut argument = OsString::from("file:");
    argument.push(std::path::absolute(path)?);
    Ok(argument)
}

/// The arguments of an input file, with the protocols and formats that may be opened.
pub(super) fn input_arguments(path: &Path) -> Result<Vec<OsString>, VideoError> {
    let fixed = [
        "-protocol_whitelist",
        PROTOCOLS,
        "-format_whitelist",
        DEMUXERS,
        "-i",
    ];
    let mut arguments: Vec<OsString> = fixed.iter().map(OsString::from).collect();
    arguments.push(file_argument(path)?);
    Ok(arguments)
}

/// Formats that are read: those that hold their frames themselves. Lists of other files (HLS, DASH, concat), descriptions
/// of devices and networks, and text that is drawn are left out, so that a file cannot name others.
const DEMUXERS: &str = "3g2,3gp,4xm,aa,aac,ac3,aiff,amr,amv,anm,apng,asf,ass,av1,avi,avs,bfi,bink,c93,caf,cavsvideo,cdg,cine,\
dhav,dirac,dnxhd,dts,dv,dxa,eac3,ea,evc,ffm,film_cpk,flac,flic,flv,fli,gif,gif_pipe,gxf,h261,h263,h264,hevc,hnm,ico,idcin,iff,\
ingenient,ipmovie,iv8,ivf,jpegxl_anim,jv,kux,live_flv,lmlm4,luodat,lvf,lxf,m4a,m4v,matroska,mgsts,mj2,mjpeg,mjpeg_2000,mlv,mm,\
mov,mp3,mp4,mpeg,mpegts,mpegvideo,mpjpeg,mtv,mv,mvi,mxf,mxg,nc,nsv,nut,nuv,obu,ogg,paf,pmp,psxstr,pva,r3d,rl2,rm,roq,rpl,\
rsd,sdr2,segafilm,ser,sga,siff,simbiosis_imx,smk,smush,srt,swf,tak,thp,tiertexseq,tmv,ty,v210,v210x,vc1,vc1test,vivo,vmd,vqf,vvc,\
wav,wc3movie,webm,webp_anim,webvtt,wsvqa,wtv,xmv,xwma,yop,yuv4mpegpipe";

/// The part of standard error that is kept.
#[derive(Debug, Default)]
struct Log {
    lines: VecDeque<String>,
    /// The last line that follows from others.
    aftermath: Option<String>,
}

impl Log {
    fn push(&mut self, line: &[u8]) {
        let text = String::from_utf8_lossy(line);
        let text = without_address(text.trim());
        if text.is_empty() {
            return;
        }
        // what FFmpeg says after the reason
        let aftermath = [
            "Conversion failed",
            "Last message repeated",
            "Error writing trailer",
            "Error closing file",
            "Exiting with exit code",
            "Terminating thread",
            "Task finished with error code",
            "Nothing was written into output file",
            "Error initializing output stream",
            "Could not write header",
        ];
        if aftermath.iter().any(|start| text.starts_with(start)) {
            self.aftermath = Some(text.to_owned());
            return;
        }
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(text.to_owned());
    }
}

/// The line without names of parts and their addresses in memory, such as `[mpeg4 @ 0x55e427661a00]`.
fn without_address(mut line: &str) -> &str {
    while let Some(rest) = line.strip_prefix('[')
        && let Some((name, rest)) = rest.split_once("] ")
        && name.contains('@')
    {
        line = rest.trim_start();
    }
    line
}

/// Reads lines until the end and keeps the last ones.
fn drain(mut stderr: impl Read, log: &Mutex<Log>) {
    let mut chunk = [0; 4096];
    let mut line = Vec::new();
    loop {
        let read = match stderr.read(&mut chunk) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(_) => break,
        };
        for byte in &chunk[..read] {
            if matches!(byte, b'\n' | b'\r') {
                lock(log).push(&line);
                line.clear();
            } else if line.len() < MAX_LINE_BYTES {
                line.push(*byte);
            }
        }
    }
    lock(log).push(&line);
}

fn lock(log: &Mutex<Log>) -> std::sync::MutexGuard<'_, Log> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running child, which is killed when it is dropped.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    log: Arc<Mutex<Log>>,
    drained: Receiver<()>,
}

/// The end of a child.
#[derive(Debug)]
pub(super) struct Ended {
    /// Its exit status.
    pub(super) status: ExitStatus,
    /// The last lines on standard error.
    pub(super) lines: Vec<String>,
}

impl Ended {
    /// The reason, in the last words of the child.
    pub(super) fn message(&self) -> String {
        self.lines
            .last()
            .cloned()
            .unwrap_or_else(|| format!("it ended without a message ({})", self.status))
    }

    /// The reason as an error.
    pub(super) fn into_error(self) -> VideoError {
        VideoError::FfmpegFailed {
            message: self.message(),
        }
    }

    /// True if the child did not end by itself.
    pub(super) fn killed(&self) -> bool {
        self.status.code().is_none()
    }
}

impl Process {
    /// Starts a child. Standard input and output are closed unless the command sets them up.
    pub(super) fn start(command: &mut Command) -> Result<Self, VideoError> {
        Self::spawn(command.stderr(Stdio::piped()))
    }

    fn spawn(command: &mut Command) -> Result<Self, VideoError> {
        // Ctrl-C in a terminal goes to the group of processes: the caller decides what it means for the child
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut child = command.spawn().map_err(|error| VideoError::FfmpegFailed {
            message: format!(
                "{} cannot be started: {}",
                command.get_program().display(),
                ravec_files::message_without_code(&error)
            ),
        })?;
        let log = Arc::new(Mutex::new(Log::default()));
        let (done, drained) = channel();
        if let Some(stderr) = child.stderr.take() {
            let log = Arc::clone(&log);
            std::thread::spawn(move || {
                drain(stderr, &log);
                // the receiver may be gone
                let _ = done.send(());
            });
        }
        Ok(Self {
            child,
            log,
            drained,
        })
    }

    /// Starts a child whose standard error is read by the caller, who must read it to its end.
    pub(super) fn start_with_log(command: &mut Command) -> Result<(Self, impl Read), VideoError> {
        let (reader, writer) = std::io::pipe()?;
        command.stderr(writer);
        let process = Self::spawn(command)?;
        // the command holds the other end of the pipe
        command.stderr(Stdio::null());
        Ok((process, reader))
    }

    /// Its standard input, once.
    pub(super) fn take_stdin(&mut self) -> Option<ChildStdin> {
        self.child.stdin.take()
    }

    /// Its standard output, once.
    pub(super) fn take_stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Waits for the end. Its pipes must have been closed, or read to their end.
    pub(super) fn wait(&mut self) -> Result<Ended, VideoError> {
        let status = self.child.wait()?;
        let _ = self.drained.recv_timeout(LAST_WORDS);
        let log = lock(&self.log);
        let mut lines: Vec<String> = log.lines.iter().cloned().collect();
        if lines.is_empty() && !status.success() {
            lines.extend(log.aftermath.clone());
        }
        Ok(Ended { status, lines })
    }

    /// Ends the child.
    pub(super) fn kill(&mut self) {
        // it may have ended already
        let _ = self.child.kill();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

/// The answer of a child to a short question.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) stdout: Vec<u8>,
    pub(super) ended: Ended,
}

/// Runs a child to its end and keeps its output, which has at most `max_bytes`. A child that does not answer is ended.
pub(super) fn capture(command: &mut Command, max_bytes: u64) -> Result<Answer, VideoError> {
    let mut process = Process::start(command.stdin(Stdio::null()).stdout(Stdio::piped()))?;
    let (sender, receiver) = channel();
    if let Some(stdout) = process.take_stdout() {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let read = stdout.take(max_bytes + 1).read_to_end(&mut bytes);
            let _ = sender.send(read.map(|_| bytes));
        });
    }
    let failed = |message: String| VideoError::FfmpegFailed { message };
    let name = command.get_program().display();
    let stdout = receiver
        .recv_timeout(ANSWER)
        .map_err(|_| failed(format!("{name} does not answer")))??;
    if stdout.len() as u64 > max_bytes {
        return Err(failed(format!("{name} says more than {max_bytes} bytes")));
    }
    let ended = process.wait()?;
    Ok(Answer { stdout, ended })
}

/// Runs a child to its end without output; `input` goes to its standard input.
pub(super) fn run(command: &mut Command, input: &[u8]) -> Result<(), VideoError> {
    let mut process = Process::start(command.stdin(Stdio::piped()).stdout(Stdio::null()))?;
    if let Some(mut stdin) = process.take_stdin() {
        // a child that ends before it has read its input says why
        let _ = std::io::Write::write_all(&mut stdin, input);
    }
    let ended = process.wait()?;
    if ended.status.success() {
        Ok(())
    } else {
        Err(ended.into_error())
    }
}

/// Arguments as they are added to a command: strings of the code, and paths.
pub(super) fn add<S: AsRef<OsStr>>(command: &mut Command, arguments: impl IntoIterator<Item = S>) {
    command.args(arguments);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_keeps_the_last_lines_and_bounded_ones() {
        let log = Mutex::new(Log::default());
        let mut text = b"x".repeat(100_000);
        for number in 0..1000 {
            text.extend(format!("\n[mpeg4 @ 0x55] [in#0 @ 0x1] line {number}").bytes());
        }
        text.extend(b"\nConversion failed!\n\n");
        drain(&text[..], &log);
        let lines = &lock(&log).lines;
        assert_eq!(lines.len(), MAX_LINES);
        assert_eq!(lines.back().map(String::as_str), Some("line 999"));
    }

    #[test]
    fn programs_are_found_by_variables_and_in_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let (program, probe) = (
            folder.path().join("other"),
            folder.path().join(executable("ffprobe")),
        );
        for path in [&program, &probe, &folder.path().join(executable("ffmpeg"))] {
            std::fs::copy(std::env::current_exe().unwrap(), path).unwrap();
        }
        let locate = |variables: &[(&str, &Path)]| {
            let found = Programs::locate_by("reading HEVC", |name| {
                let found = variables.iter().find(|(known, _)| *known == name);
                found.map(|(_, value)| value.as_os_str().to_owned())
            });
            found.map(|found| (found.ffmpeg, found.ffprobe))
        };
        let by_path = locate(&[("PATH", folder.path())]).unwrap();
        assert_eq!(
            by_path,
            (folder.path().join(executable("ffmpeg")), probe.clone())
        );
        let by_name = locate(&[("RAVEC_FFMPEG", &program)]).unwrap();
        assert_eq!(by_name, (program.clone(), probe.clone()));
        let both = locate(&[("RAVEC_FFMPEG", &program), ("RAVEC_FFPROBE", &program)]).unwrap();
        assert_eq!(both, (program.clone(), program.clone()));
        let nowhere = Path::new("/nowhere");
        for variables in [
            &[][..],
            &[("PATH", Path::new(""))],
            &[("PATH", nowhere)],
            &[("PATH", folder.path()), ("RAVEC_FFMPEG", nowhere)],
            &[("PATH", folder.path()), ("RAVEC_FFPROBE", nowhere)],
        ] {
            let message = locate(variables).unwrap_err().to_string();
            assert!(
                message.starts_with("reading HEVC needs FFmpeg, which was not found"),
                "{message}"
            );
        }
    }

    #[test]
    fn a_path_is_never_an_option_or_an_address() {
        for name in [
            "-y",
            "http://example.com/a.mkv",
            "concat:a|b",
            "pipe:0",
            "a b'c.mkv",
        ] {
            let argument = file_argument(Path::new(name)).unwrap();
            let text = argument.into_string().unwrap();
            let path = text.strip_prefix("file:").unwrap();
            assert!(Path::new(path).is_absolute(), "{text}");
        }
    }
}
