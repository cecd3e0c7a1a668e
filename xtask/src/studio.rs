//! The studio in a real window: the test that drives it, and the pictures of its guide.

use anyhow::{Context as _, bail};
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Scripts that take the pictures of the guide.
const GUIDE: [&str; 5] = [
    "guide",
    "guide-retarget",
    "guide-mesh",
    "guide-clip",
    "guide-shot",
];

fn cargo() -> Command {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    command
}

/// Runs the test `window` of `ravec-studio`, which skips itself where there is no `Xvfb` or `xdotool`.
pub fn window() -> anyhow::Result<()> {
    let status = cargo()
        .args(["test", "--package", "ravec-studio", "--test", "window"])
        .args(["--", "--nocapture"])
        .status()?;
    if !status.success() {
        bail!("the studio does not work in a window");
    }
    Ok(())
}

/// A screen in memory, which ends with the chore.
struct Screen(Child);

impl Drop for Screen {
    fn drop(&mut self) {
        // it may have ended
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Screen {
    /// Starts `Xvfb`; the screen and its name.
    fn start() -> anyhow::Result<(Self, String)> {
        let mut child = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x820x24"])
            .args(["-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .context("Xvfb (apt-get install xvfb mesa-vulkan-drivers libxkbcommon-x11-0)")?;
        let output = child.stdout.take().context("Xvfb has no output")?;
        let screen = Self(child);
        let mut number = String::new();
        BufReader::new(output).read_line(&mut number)?;
        if number.trim().is_empty() {
            bail!("Xvfb has no display");
        }
        Ok((screen, format!(":{}", number.trim())))
    }
}

/// Makes the pictures `docs/images/studio-*.jpg` from the running program.
pub fn guide_pictures() -> anyhow::Result<()> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let (_screen, display) = Screen::start()?;
    for name in GUIDE {
        let script = format!("crates/ravec-studio/scripts/{name}.json");
        let status = cargo()
            .args(["run", "--release", "--package", "ravec-studio", "--"])
            .args(["--measure", &script, "--window", "--pictures"])
            .arg(root.join("docs/images"))
            .env("DISPLAY", &display)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .stdout(Stdio::null())
            .status()?;
        if !status.success() {
            bail!("{script} failed");
        }
    }
    Ok(())
}
