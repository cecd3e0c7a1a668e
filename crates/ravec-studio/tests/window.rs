//! The program in a real window, driven by the events of an X server: `Xvfb` is the screen, `xdotool` the hand.
//!
//! Where one of the two is not installed, the test is skipped, and says so on standard error.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use ravec_jobs::{Context, Operation as _, Step, recipe};
use ravec_studio::Control;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A bound on the time that anything may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(1);
/// Time between two looks.
const POLL: Duration = Duration::from_millis(40);
/// Largest distance between the place of the hand and that of the pointer in the window, in points.
const NEAR: f32 = 1.5;

/// Looks until something is there.
fn wait<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(start.elapsed() < HANG, "waited in vain for {what}");
        std::thread::sleep(POLL);
    }
}

fn is_installed(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// A process that ends with the test.
struct Running(Child);

impl Running {
    /// Ends it without any chance to save.
    fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // it may have ended
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A screen, and a folder for files and for the state of the program.
struct Desk {
    folder: tempfile::TempDir,
    display: String,
    _screen: Running,
}

impl Desk {
    fn new() -> Self {
        let mut screen = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x820x24"])
            .args(["-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let output = screen.stdout.take().unwrap();
        let screen = Running(screen);
        let mut number = String::new();
        BufReader::new(output).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb has no display");
        Self {
            folder: tempfile::tempdir().unwrap(),
            display: format!(":{}", number.trim()),
            _screen: screen,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Starts the program, and waits for its window.
    fn start(&self) -> Window<'_> {
        let list = self.path("controls.json");
        // what is there belongs to the run before
        let _ = std::fs::remove_file(&list);
        let messages = std::fs::File::create(self.path("messages.txt")).unwrap();
        let program = Command::new(env!("CARGO_BIN_EXE_ravec-studio"))
            .arg("--controls")
            .arg(&list)
            .env("DISPLAY", &self.display)
            .env("XDG_STATE_HOME", self.path("state"))
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .stdout(Stdio::null())
            .stderr(messages)
            .spawn()
            .unwrap();
        let mut window = Window {
            desk: self,
            program: Running(program),
        };
        wait("the window", || {
            if let Some(status) = window.program.0.try_wait().unwrap() {
                let messages = std::fs::read_to_string(self.path("messages.txt")).unwrap();
                panic!("the program has ended, {status}:\n{messages}");
            }
            window.find("Find…")
        });
        let found = self.hand(&[
            "search",
            "--sync",
            "--onlyvisible",
            "--name",
            "Ravec Studio",
        ]);
        let number = found.lines().next().unwrap().to_owned();
        // without a window manager nobody else does it
        self.hand(&["windowmove", &number, "0", "0"]);
        self.hand(&["windowfocus", &number]);
        window
    }

    /// The copy of a document that the program keeps while it runs.
    fn copy(&self, number: u32) -> String {
        let runs = std::fs::read_dir(self.path("state/ravec/studio"));
        let runs = runs.into_iter().flatten().flatten();
        let texts = runs.map(|run| text_of(&run.path().join(format!("{number}.json"))));
        texts.collect()
    }

    /// The planes in the copy of the first document.
    fn planes(&self) -> Option<Value> {
        let project: Value = serde_json::from_str(&self.copy(1)).ok()?;
        let edits = project["editor"]["edits"].as_array()?;
        let planes = &edits.last()?["fields"]["params"]["planes"];
        (!planes.is_null()).then(|| planes.clone())
    }

    fn hand(&self, arguments: &[&str]) -> String {
        let output = Command::new("xdotool")
            .args(arguments)
            .env("DISPLAY", &self.display)
            .output()
            .unwrap();
        assert!(output.status.success(), "xdotool {arguments:?}: {output:?}");
        String::from_utf8(output.stdout).unwrap()
    }
}

/// The program in its window.
struct Window<'a> {
    desk: &'a Desk,
    program: Running,
}

impl Window<'_> {
    /// The controls, once they do not change any more.
    fn controls(&self) -> Option<Vec<Control>> {
        let read = || std::fs::read(self.desk.path("controls.json")).ok();
        let first = read()?;
        std::thread::sleep(POLL);
        (read()? == first).then(|| serde_json::from_slice(&first).unwrap())
    }

    /// The control of a name that can be used, or the text.
    fn find(&self, name: &str) -> Option<Control> {
        let all = self.controls()?;
        let mut named = all.iter().filter(|control| control.name == name);
        let usable = named.find(|control| control.enabled && control.role != "Label");
        usable
            .or_else(|| {
                all.iter()
                    .find(|control| control.name == name && control.enabled)
            })
            .cloned()
    }

    fn see(&self, name: &str) -> Control {
        wait(name, || self.find(name))
    }

    /// The size of the picture that is shown, by the line at the bottom.
    fn size(&self) -> Option<[f32; 2]> {
        self.controls()?.iter().find_map(|control| {
            let (width, height) = control.name.split_once(" × ")?;
            Some([width.parse().ok()?, height.parse().ok()?])
        })
    }

    /// Number of triangles, likewise.
    fn triangles(&self) -> Option<usize> {
        self.controls()?.iter().find_map(|control| {
            let (count, word) = control.name.split_once(' ')?;
            count.parse().ok().filter(|_| word == "triangles")
        })
    }

    /// Moves the pointer, and waits until a frame of the window knows it.
    fn move_to(&self, to: [f32; 2]) {
        let [x, y] = to.map(|value| value.round().to_string());
        self.desk.hand(&["mousemove", "--", &x, &y]);
        wait("the pointer at its place", || {
            let at = self.find("Pointer")?.rect().min;
            let is_near = (at.x - to[0]).abs() <= NEAR && (at.y - to[1]).abs() <= NEAR;
            is_near.then_some(())
        });
    }

    /// Presses or releases the first button, and waits until a frame of the window knows it.
    fn button(&self, event: &str, value: &str) {
        self.desk.hand(&[event, "1"]);
        wait(event, || {
            let pointer = self.find("Pointer")?;
            (pointer.value.as_deref() == Some(value)).then_some(())
        });
    }

    fn click(&self, name: &str) {
        // what is above it may still change, and move it
        wait(name, || {
            let place = self.find(name)?.rect().center();
            self.move_to([place.x, place.y]);
            self.find(name)?.rect().contains(place).then_some(())
        });
        self.button("mousedown", "down");
        self.button("mouseup", "up");
    }

    /// Drags through points of the picture, given in pixels of it.
    fn drag(&self, points: &[[f32; 2]]) {
        let area = self.see("Canvas").rect();
        let [width, height] = wait("the size of the picture", || self.size());
        let zoom = (area.width() / width).min(area.height() / height) * 0.96;
        let place = |[x, y]: [f32; 2]| {
            let center = area.center();
            [
                center.x + zoom * (x - 0.5 * width),
                center.y + zoom * (y - 0.5 * height),
            ]
        };
        self.move_to(place(points[0]));
        self.button("mousedown", "down");
        for pair in points.windows(2) {
            for step in 1..=4 {
                let share = step as f32 / 4.0;
                self.move_to(place(
                    [0, 1].map(|k| pair[0][k] + share * (pair[1][k] - pair[0][k])),
                ));
            }
        }
        self.button("mouseup", "up");
    }

    fn press(&self, keys: &str) {
        self.desk.hand(&["key", keys]);
    }

    /// Opens a file by its path.
    fn open(&self, path: &Path) {
        self.press("ctrl+o");
        self.see("Open a picture, a mesh, a clip or a project: Open");
        let path = path.to_str().unwrap();
        let value = || {
            let all = self.controls()?;
            let focused = all.into_iter().filter(|control| control.focused);
            focused
                .map(|control| control.value.unwrap_or_default())
                .next()
        };
        wait("the field", || value().filter(String::is_empty));
        self.desk.hand(&["type", "--delay", "30", path]);
        let typed = wait("the path", || {
            value().filter(|value| value.len() >= path.len())
        });
        assert_eq!(typed, path);
        self.press("Return");
    }

    /// Presses keys, and Enter in the dialog that they open.
    fn confirm(&self, keys: &str, button: &str) {
        self.press(keys);
        self.see(button);
        self.press("Return");
        wait("the end of the dialog", || {
            self.find(button).is_none().then_some(())
        });
    }

    fn wait_for_result(&self) {
        wait("the result", || {
            let all = self.controls()?;
            let old = all.iter().any(|control| control.name == "older result");
            (!old).then_some(())
        });
    }
}

/// The bytes that `ravec run` writes for a project.
fn bytes_of_run(project: &Path, output: &Path) -> Vec<u8> {
    std::fs::remove_file(output).unwrap();
    let run = recipe::Run {
        file: project.to_path_buf(),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    std::fs::read(output).unwrap()
}

fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

#[test]
fn a_session_in_a_window_outlives_a_kill() {
    for program in ["Xvfb", "xdotool"] {
        if !is_installed(program) {
            // past the capture of the test harness: this must be seen
            let line = format!(
                "window: SKIPPED: {program} is not installed (apt-get install xvfb xdotool mesa-vulkan-drivers libxkbcommon-x11-0)"
            );
            writeln!(std::io::stderr(), "{line}").unwrap();
            return;
        }
    }
    let desk = Desk::new();
    let scene = json!({
        "operation": "scenes",
        "out": desk.folder.path(),
        "params": {"scenes": ["facade"], "width": 240, "height": 160},
    });
    let scene: Step = serde_json::from_value(scene).unwrap();
    scene.operation().run(&Context::default()).unwrap();
    let solid = "OFF\n8 12 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
        3 0 2 1\n3 0 3 2\n3 4 5 6\n3 4 6 7\n3 0 1 5\n3 0 5 4\n3 1 2 6\n3 1 6 5\n3 2 3 7\n3 2 7 6\n3 3 0 4\n3 3 4 7\n";
    std::fs::write(desk.path("box.off"), solid).unwrap();

    let mut window = desk.start();
    window.open(&desk.path("facade.png"));
    window.click("Brush");
    // the panel knows the picture: the tool is ready
    window.see("0 strokes");
    let way = [[40.0, 40.0], [120.0, 60.0], [180.0, 120.0]];
    window.drag(&way);
    window.see("1 stroke");

    window.click("Retarget");
    window.see("Drag the frame");
    window.wait_for_result();
    window.drag(&[[240.0, 80.0], [200.0, 80.0]]);
    let [width, height] = wait("a narrower picture", || {
        window.size().filter(|size| size[0] < 220.0)
    });
    assert!(
        (width - 200.0).abs() <= 2.0 && height == 160.0,
        "{width} x {height}"
    );
    window.wait_for_result();

    window.click("Complete");
    window.see("Remove Complete");
    window.wait_for_result();
    let around = [
        [80.0, 60.0],
        [120.0, 60.0],
        [120.0, 100.0],
        [80.0, 100.0],
        [80.0, 62.0],
    ];
    window.drag(&around);
    window.see("Remove the area");
    window.click("Planes");
    window.click("Add a plane");
    wait("a plane", || window.find("Remove planes"));
    let start = wait("the plane in the copy", || desk.planes());
    window.drag(&[[50.0, 40.0], [40.0, 30.0]]);
    wait("another corner", || {
        desk.planes().filter(|planes| *planes != start)
    });
    window.click("Fill");
    window.wait_for_result();

    let (picture_project, picture) = (
        desk.path("facade.ravec.json"),
        desk.path("facade-edited.png"),
    );
    window.confirm("ctrl+s", "Save the project: Save");
    let saved = wait("the saved project", || {
        let text = text_of(&picture_project);
        (!text.is_empty()).then_some(text)
    });
    for word in ["\"strokes\"", "\"polygons\"", "\"planes\"", "x160"] {
        assert!(saved.contains(word), "{word} is not in {saved}");
    }

    window.open(&desk.path("box.off"));
    window.click("Offset");
    wait("the offset", || {
        window.triangles().filter(|count| *count > 12)
    });
    window.wait_for_result();

    window.press("ctrl+Tab");
    window.see("Remove Complete");
    window.click("Two-color view");
    window.see("Remove Two-color view");
    wait("the copies of both documents", || {
        let both = desk.copy(1).contains("twocolor") && desk.copy(2).contains("\"offset\"");
        both.then_some(())
    });
    window.program.kill();

    let window = desk.start();
    window.see("2 documents that were not saved are open again");
    let (mesh_project, mesh) = (desk.path("box.ravec.json"), desk.path("box-edited.ply"));
    for (tool, project, output) in [
        ("Remove Offset", &mesh_project, &mesh),
        ("Remove Two-color view", &picture_project, &picture),
    ] {
        window.see(tool);
        window.wait_for_result();
        window.confirm("ctrl+e", "Export the result: Export");
        window.see(&format!("Written: {}", output.display()));
        window.confirm("ctrl+s", "Save the project: Save");
        window.see(&format!("{} is saved", project.display()));
        let exported = std::fs::read(output).unwrap();
        assert!(
            bytes_of_run(project, output) == exported,
            "{} is not what `ravec run` writes",
            output.display()
        );
        window.press("ctrl+Tab");
    }
}
