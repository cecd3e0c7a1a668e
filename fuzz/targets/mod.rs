//! Bodies of the fuzz targets: one function for each reader, from bytes to an [`Outcome`].
//!
//! The fuzzer (`fuzz/src/main.rs`) calls them with mutated inputs. The test `corpus` of `ravec-jobs` includes this module
//! and calls them with every file below `fuzz/corpus`, so that nobody needs a fuzzer or a C++ compiler to replay what was
//! found. A body panics if the reader breaks a promise; [`run`] adds what holds for all of them: no panic that the reader
//! did not contain, and no more memory than [`limits`] allow.

mod catalogue;
mod clips;
mod limits;
pub mod memory;
mod meshes;
mod packages;
mod panics;
mod parameters;
mod pictures;
mod steps;
mod strokes;

pub use panics::{take_foreign, watch};

/// The end of a run that kept all promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The reader took the input.
    Read,
    /// The reader refused the input with an error.
    Refused,
}

impl Outcome {
    /// `Read` for a value, `Refused` for an error with a sentence.
    pub fn of<T, E: std::fmt::Display>(result: &Result<T, E>) -> Self {
        match result {
            Ok(_) => Self::Read,
            Err(error) => {
                let sentence = error.to_string();
                assert!(sentence.len() > 5, "an error says nothing: {sentence:?}");
                Self::Refused
            }
        }
    }
}

/// A reader and what it may cost.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// The name, which is that of the folder with its inputs.
    pub name: &'static str,
    /// Reads an input, and panics if a promise is broken.
    pub body: fn(&[u8]) -> Outcome,
    /// The most bytes that a run may hold at a time.
    pub max_held: usize,
}

const fn picture(name: &'static str) -> Target {
    Target {
        name,
        body: pictures::read,
        max_held: limits::PICTURE_BYTES,
    }
}

const fn mesh(name: &'static str, body: fn(&[u8]) -> Outcome) -> Target {
    Target {
        name,
        body,
        max_held: limits::MESH_HELD,
    }
}

/// For data whose size is that of the input but for small factors.
const fn small(name: &'static str, body: fn(&[u8]) -> Outcome) -> Target {
    Target {
        name,
        body,
        max_held: 64 << 20,
    }
}

/// All targets.
pub const TARGETS: &[Target] = &[
    picture("png"),
    picture("jpeg"),
    Target {
        // for a partition of a lossy frame the decoder takes what its header says, up to 16 MiB, before it looks at the file
        max_held: limits::PICTURE_BYTES + (17 << 20),
        ..picture("webp")
    },
    picture("tiff"),
    picture("bmp"),
    picture("exr"),
    picture("hdr"),
    mesh("stl", meshes::read),
    mesh("ply", meshes::read),
    mesh("obj", meshes::read),
    mesh("off", meshes::read),
    mesh("gltf", meshes::read),
    mesh("threemf_package", meshes::read),
    mesh("threemf_model", packages::read_model),
    Target {
        name: "mp4",
        body: clips::read_mp4,
        max_held: limits::CLIP_BYTES,
    },
    small("y4m", clips::read_y4m),
    Target {
        name: "catalogue_file",
        body: catalogue::read_file,
        max_held: 64 << 20,
    },
    small("catalogue_rows", catalogue::read_rows),
    Target {
        // a stroke of a few bytes may stand for four million dabs, which grow to 128 MiB
        max_held: 192 << 20,
        ..small("strokes", strokes::read)
    },
    small("steps", steps::read),
    small("expression", parameters::read_expression),
    small("parameters", parameters::read),
];

/// Runs a target on an input, and says which promise was broken.
///
/// Installs a panic hook, so that panics can be distinguished: those of our own code break a promise wherever they are
/// caught, those of foreign decoders only if the reader did not contain them.
///
/// # Errors
/// The promise that was broken, as a sentence.
pub fn run(target: &Target, input: &[u8]) -> Result<Outcome, String> {
    watch();
    // what an earlier run left
    let _ = (panics::take_own(), take_foreign());
    let (result, held) = memory::measured(|| {
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| (target.body)(input)))
    });
    if let Some(own) = panics::take_own() {
        return Err(own);
    }
    let Ok(outcome) = result else {
        return Err(format!(
            "a foreign panic was not contained: {}",
            take_foreign().unwrap_or_default()
        ));
    };
    if held > target.max_held {
        return Err(format!(
            "{held} bytes were held, more than {}",
            target.max_held
        ));
    }
    Ok(outcome)
}
