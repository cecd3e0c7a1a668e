//! Scripts of gestures: read strictly, since they are files like others.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Maximum size of a script in bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Maximum number of steps, those that are repeated counted once.
const MAX_STEPS: usize = 500;
/// Maximum number of events: about a quarter of an hour of a hand that never rests.
const MAX_EVENTS: u64 = 100_000;
/// Maximum number of points of a way.
const MAX_POINTS: usize = 1000;
/// Maximum length of a name or text in bytes.
const MAX_TEXT: usize = 200;
/// Range of fractions of a picture or a control: a little beyond its borders.
const PLACES: [f64; 2] = [-1.0, 2.0];

/// A recorded session: what is opened, and what the hand does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// Version of the format: 1.
    pub version: u32,
    /// Subject of the measurement, in a sentence.
    #[serde(default)]
    pub about: String,
    /// Columns and rows of the window in points, 200 to 4000.
    #[serde(default = "default_window")]
    pub window: [u32; 2],
    /// The document.
    pub open: Opened,
    /// Actions of the hand, in turn. Each step begins when nothing is going on any more.
    pub steps: Vec<Step>,
}

fn default_window() -> [u32; 2] {
    [1280, 820]
}

/// Document of a script.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Opened {
    /// A file. A relative path starts at the folder of the script.
    File(PathBuf),
    /// A procedural picture or clip, written to a temporary folder before the clock starts.
    Scene {
        /// Name, as `ravec scenes` has it.
        name: String,
        /// Columns, 16 to 8192.
        width: u32,
        /// Rows, 16 to 8192.
        height: u32,
        /// Frames of a clip, 1 to 2000.
        #[serde(default)]
        frames: Option<u32>,
    },
    /// A torus, written to a temporary folder.
    Torus {
        /// Number of triangles, 100 to 2000000; rounded to what a grid has.
        triangles: u32,
    },
}

/// Action of the hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Step {
    /// Clicks a control, or a point of the picture.
    Click {
        /// Accessible name of the control.
        #[serde(default)]
        control: Option<String>,
        /// Fractions of the control or of the picture (default: the middle).
        #[serde(default = "middle")]
        at: [f64; 2],
        /// Name of the figures that it belongs to; without it nothing is measured.
        #[serde(default)]
        measure: Option<String>,
    },
    /// Presses and releases a key.
    Press {
        /// Name of the key, such as `S` or `Enter`.
        key: String,
        /// True while Ctrl is held.
        #[serde(default)]
        ctrl: bool,
        /// Name of the figures.
        #[serde(default)]
        measure: Option<String>,
    },
    /// Types a number or text into the field of a control, and Enter.
    Set {
        /// Accessible name of the control.
        control: String,
        /// The text.
        text: String,
        /// Name of the figures.
        #[serde(default)]
        measure: Option<String>,
    },
    /// Moves with the button held.
    Drag(Way),
    /// Moves without a button.
    Move(Way),
    /// Turns the wheel.
    Turn {
        /// Accessible name of the control under the cursor; without it the picture.
        #[serde(default)]
        control: Option<String>,
        /// Fractions of the control or of the picture (default: the middle).
        #[serde(default = "middle")]
        at: [f64; 2],
        /// Notches, up positive, -100 to 100 without 0.
        notches: i32,
        /// True while Shift is held.
        #[serde(default)]
        shift: bool,
        /// Name of the figures.
        #[serde(default)]
        measure: Option<String>,
    },
    /// Takes a picture of the window, which a script that is played without one cannot.
    Picture {
        /// Name of the file without its extension: small letters, digits and hyphens.
        name: String,
    },
    /// Does some steps several times.
    Repeat {
        /// How often, 1 to 1000.
        times: u32,
        /// The steps; none of them repeats.
        steps: Vec<Step>,
    },
}

fn middle() -> [f64; 2] {
    [0.5, 0.5]
}

/// A way of the hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Way {
    /// Accessible name of the control whose fractions the points are; without it those of the picture.
    #[serde(default)]
    pub control: Option<String>,
    /// Corners of the way, from -1 to 2: 0 is the left or upper border, 1 the right or lower one.
    pub points: Vec<[f64; 2]>,
    /// Number of motions, evenly spaced along the way, 1 to 10000.
    pub moves: u32,
    /// Motions a second, 1 to 1000 (default 125, as mice have it).
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// Name of the figures.
    #[serde(default)]
    pub measure: Option<String>,
}

fn default_rate() -> f64 {
    125.0
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// One sentence that starts with the path.
    pub fn load(path: &Path) -> Result<Self, String> {
        let failed = |reason: &dyn std::fmt::Display| format!("{}: {reason}", path.display());
        let length = std::fs::metadata(path)
            .map_err(|error| failed(&error))?
            .len();
        if length > MAX_BYTES {
            return Err(failed(&format!(
                "a script has at most {MAX_BYTES} bytes, and this has {length}"
            )));
        }
        let text = std::fs::read_to_string(path).map_err(|error| failed(&error))?;
        Self::from_json(&text).map_err(|reason| failed(&reason))
    }

    /// Reads the text of a script.
    ///
    /// # Errors
    /// One sentence.
    pub fn from_json(text: &str) -> Result<Self, String> {
        let script: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        script.check()?;
        Ok(script)
    }

    fn check(&self) -> Result<(), String> {
        if self.version != 1 {
            return Err(format!("version {} is not known, only 1 is", self.version));
        }
        let [width, height] = self.window;
        if !(200..=4000).contains(&width) || !(200..=4000).contains(&height) {
            return Err(format!(
                "the window is {width} x {height}, and a side has 200 to 4000 points"
            ));
        }
        match &self.open {
            Opened::File(_) => {}
            Opened::Scene {
                width,
                height,
                frames,
                ..
            } => {
                for side in [width, height] {
                    if !(16..=8192).contains(side) {
                        return Err(format!(
                            "a side of the scene has {side} pixels, and may have 16 to 8192"
                        ));
                    }
                }
                if frames.is_some_and(|frames| !(1..=2000).contains(&frames)) {
                    return Err("a clip has 1 to 2000 frames".to_owned());
                }
            }
            Opened::Torus { triangles } => {
                if !(100..=2_000_000).contains(triangles) {
                    return Err(format!(
                        "the torus has {triangles} triangles, and may have 100 to 2000000"
                    ));
                }
            }
        }
        let mut steps = 0;
        let mut events = 0;
        for step in &self.steps {
            if let Step::Repeat {
                times,
                steps: inner,
            } = step
            {
                if !(1..=1000).contains(times) {
                    return Err(format!("steps are repeated 1 to 1000 times, not {times}"));
                }
                for step in inner {
                    events += u64::from(*times) * step.check()?;
                }
                steps += inner.len();
            } else {
                events += step.check()?;
                steps += 1;
            }
        }
        if steps > MAX_STEPS {
            return Err(format!(
                "a script has at most {MAX_STEPS} steps, and this has {steps}"
            ));
        }
        if events > MAX_EVENTS {
            return Err(format!(
                "a script has at most {MAX_EVENTS} events, and this has {events}"
            ));
        }
        Ok(())
    }

    /// The steps in turn, repeated ones as often as they are.
    pub(super) fn unrolled(&self) -> Vec<&Step> {
        let mut all = Vec::new();
        for step in &self.steps {
            match step {
                Step::Repeat { times, steps } => {
                    for _ in 0..*times {
                        all.extend(steps);
                    }
                }
                step => all.push(step),
            }
        }
        all
    }
}

impl Step {
    /// Number of events at most.
    fn check(&self) -> Result<u64, String> {
        if let Some(name) = self.measure() {
            check_text(name)?;
        }
        match self {
            Self::Click { control, at, .. } => {
                check_place(control.as_deref(), &[*at])?;
                Ok(3)
            }
            Self::Press { key, .. } => {
                if egui::Key::from_name(key).is_none() {
                    return Err(format!("there is no key {key:?}"));
                }
                Ok(2)
            }
            Self::Set { control, text, .. } => {
                check_text(control)?;
                check_text(text)?;
                Ok(8)
            }
            Self::Drag(way) | Self::Move(way) => {
                check_place(way.control.as_deref(), &way.points)?;
                if !(1..=MAX_POINTS).contains(&way.points.len()) {
                    return Err(format!("a way has 1 to {MAX_POINTS} points"));
                }
                if !(1..=10_000).contains(&way.moves) {
                    return Err(format!("a way has 1 to 10000 motions, not {}", way.moves));
                }
                if !(1.0..=1000.0).contains(&way.rate_hz) {
                    return Err(format!(
                        "there are 1 to 1000 motions a second, not {}",
                        way.rate_hz
                    ));
                }
                Ok(u64::from(way.moves) + 3)
            }
            Self::Turn {
                control,
                at,
                notches,
                ..
            } => {
                check_place(control.as_deref(), &[*at])?;
                if *notches == 0 || notches.abs() > 100 {
                    return Err(format!(
                        "the wheel turns by 1 to 100 notches, not {notches}"
                    ));
                }
                Ok(u64::from(notches.unsigned_abs()) + 1)
            }
            Self::Picture { name } => {
                check_text(name)?;
                let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
                if name.is_empty() || !name.chars().all(plain) {
                    return Err(format!(
                        "the name of a picture has small letters, digits and hyphens, not {name:?}"
                    ));
                }
                Ok(1)
            }
            Self::Repeat { .. } => Err("repeated steps may not repeat steps".to_owned()),
        }
    }

    /// Name of the figures.
    pub(super) fn measure(&self) -> Option<&str> {
        match self {
            Self::Click { measure, .. }
            | Self::Press { measure, .. }
            | Self::Set { measure, .. }
            | Self::Turn { measure, .. }
            | Self::Drag(Way { measure, .. })
            | Self::Move(Way { measure, .. }) => measure.as_deref(),
            Self::Picture { .. } | Self::Repeat { .. } => None,
        }
    }
}

fn check_text(text: &str) -> Result<(), String> {
    if text.len() > MAX_TEXT {
        return Err(format!("a name or text has at most {MAX_TEXT} bytes"));
    }
    Ok(())
}

fn check_place(control: Option<&str>, points: &[[f64; 2]]) -> Result<(), String> {
    check_text(control.unwrap_or_default())?;
    let [low, high] = PLACES;
    match points
        .iter()
        .flatten()
        .find(|at| !(low..=high).contains(*at))
    {
        Some(at) => Err(format!(
            "a place is a fraction from {low} to {high}, not {at}"
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn script(open: &str, steps: &str) -> Result<Script, String> {
        Script::from_json(&format!(
            r#"{{"version": 1, "open": {open}, "steps": [{steps}]}}"#
        ))
    }

    const TORUS: &str = r#"{"torus": {"triangles": 200}}"#;

    #[test]
    fn repeated_steps_are_unrolled() {
        let press = r#"{"do": "press", "key": "S"}"#;
        let steps =
            format!(r#"{press}, {{"do": "repeat", "times": 3, "steps": [{press}, {press}]}}"#);
        assert_eq!(script(TORUS, &steps).unwrap().unrolled().len(), 7);
    }

    #[test]
    fn what_makes_no_sense_is_refused_in_words() {
        let scene = r#"{"scene": {"name": "street", "width": 9000, "height": 100}}"#;
        let cases = [
            (scene, "", "9000 pixels"),
            (r#"{"torus": {"triangles": 5}}"#, "", "5 triangles"),
            (r#"{"cube": {}}"#, "", "unknown variant"),
            (TORUS, r#"{"do": "press", "key": "Nothing"}"#, "no key"),
            (TORUS, r#"{"do": "jump"}"#, "unknown variant"),
            (TORUS, r#"{"do": "press", "key": "S", "often": 2}"#, "often"),
            (
                TORUS,
                r#"{"do": "drag", "points": [], "moves": 4}"#,
                "1 to 1000 points",
            ),
            (
                TORUS,
                r#"{"do": "drag", "points": [[0, 7]], "moves": 4}"#,
                "fraction",
            ),
            (
                TORUS,
                r#"{"do": "drag", "points": [[0, 1]], "moves": 0}"#,
                "motions",
            ),
            (
                TORUS,
                r#"{"do": "move", "points": [[0, 1]], "moves": 4, "rate_hz": 0}"#,
                "a second",
            ),
            (TORUS, r#"{"do": "turn", "notches": 0}"#, "notches"),
            (TORUS, r#"{"do": "picture", "name": "../a"}"#, "hyphens"),
            (
                TORUS,
                r#"{"do": "repeat", "times": 2, "steps": [{"do": "repeat", "times": 2, "steps": []}]}"#,
                "may not repeat",
            ),
            (
                TORUS,
                r#"{"do": "repeat", "times": 1000, "steps": [{"do": "move", "points": [[0, 1]], "moves": 9000}]}"#,
                "at most 100000 events",
            ),
        ];
        for (open, steps, expected) in cases {
            let refused = script(open, steps).unwrap_err();
            assert!(refused.contains(expected), "{refused}");
        }
        let other = r#"{"version": 2, "open": {"torus": {"triangles": 200}}, "steps": []}"#;
        assert!(Script::from_json(other).unwrap_err().contains("version 2"));
    }
}
