//! Fragments of a picture that fill its hole one by one.
//!
//! The index is kept here, with the picture after the steps of the last call. The list of steps is kept in Python; a call takes or undoes
//! those that differ, about a millisecond each.

use crate::array::{self, PixelKind};
use crate::error::{of_request, of_task};
use crate::work;
use glam::DVec2;
use pyo3::prelude::*;
use ravec::completion::{
    CompleteError, FillOptions, Retouch, RetouchState, SearchOptions, Shape, Sources, Step, Target,
    Variant,
};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, LinearRgba, with_image};
use serde_json::json;
use std::sync::{Arc, Mutex, PoisonError};

struct Prepared {
    image: AnyImage,
    index: ravec::completion::FragmentIndex,
    /// The state after the last call; none while a call uses it.
    state: Mutex<Option<RetouchState>>,
}

/// Everything that may be copied from, prepared for searches.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct FragmentIndex {
    prepared: Arc<Prepared>,
    kind: PixelKind,
}

/// Additional sources of fragments.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SourceOptions<'py> {
    planes: Vec<[[f64; 2]; 4]>,
    photos: Vec<Bound<'py, PyAny>>,
    features: Option<Bound<'py, PyAny>>,
    mirror: bool,
    turns: Vec<f64>,
    scales: Vec<f64>,
    color_space: String,
}

/// A target and how it is sought.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct BestOptions {
    at: [f64; 2],
    radius: u32,
    square: bool,
    plane: Option<usize>,
    count: usize,
    apart: f64,
}

fn raised(error: CompleteError) -> PyErr {
    match error {
        CompleteError::Cancelled(_) | CompleteError::NoSource { .. } => of_task(error),
        error => of_request(error),
    }
}

fn steps_of(json: &str) -> PyResult<Vec<Step>> {
    serde_json::from_str(json).map_err(of_request)
}

impl Prepared {
    /// Works on the state after some steps.
    fn after<T>(
        &self,
        steps: &[Step],
        progress: &Progress,
        work: impl FnOnce(&mut Retouch<'_>) -> PyResult<T>,
    ) -> PyResult<T> {
        let state = || self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = state().take();
        let resumed = kept.and_then(|kept| Retouch::resume(&self.index, kept));
        let mut retouch = resumed.unwrap_or_else(|| Retouch::new(&self.index));
        let followed = retouch.follow(steps, &progress.silent());
        let result = followed.map_err(raised).and_then(|()| work(&mut retouch));
        *state() = Some(retouch.suspend());
        result
    }
}

/// Copies as they are, and all mirrored, turned and scaled ones.
fn variants(options: &SourceOptions<'_>) -> Vec<Variant> {
    let mut variants = Vec::new();
    let or_plain = |values: &[f64], plain: f64| {
        let mut all = vec![plain];
        all.extend(values.iter().copied().filter(|value| *value != plain));
        all
    };
    for scale in or_plain(&options.scales, 1.0) {
        for turn in or_plain(&options.turns, 0.0) {
            for mirrored in [false, true] {
                if mirrored && !options.mirror {
                    continue;
                }
                variants.push(Variant {
                    turn_rad: turn.to_radians(),
                    mirrored,
                    scale,
                });
            }
        }
    }
    variants.retain(|variant| *variant != Variant::default());
    variants
}

#[pymethods]
impl FragmentIndex {
    #[new]
    #[pyo3(signature = (image, hole, options, progress = None))]
    fn new(
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        hole: &Bound<'_, PyAny>,
        options: SourceOptions<'_>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let linear = PixelKind::is_linear(&options.color_space)?;
        let (image, kind) = array::picture(image, linear)?;
        let hole = array::mask(hole)?;
        let features = options.features.as_ref().map(array::mask).transpose()?;
        let mut photos: Vec<Image<LinearRgba>> = Vec::new();
        for photo in &options.photos {
            photos.push(array::picture(photo, linear)?.0.convert());
        }
        let planes: Vec<[DVec2; 4]> = options
            .planes
            .iter()
            .map(|quad| quad.map(DVec2::from_array))
            .collect();
        let variants = variants(&options);
        let prepared = work::run(py, progress, move |progress| {
            // photos and picture have one type
            let pixels: Image<LinearRgba> = image.convert();
            let sources = Sources {
                planes: &planes,
                photos: &photos,
                features: features.as_ref(),
                variants: &variants,
                ..Sources::new(&pixels, &hole)
            };
            let index = ravec::completion::FragmentIndex::new(&sources, progress);
            Ok(Prepared {
                index: index.map_err(raised)?,
                image,
                state: Mutex::default(),
            })
        })?;
        Ok(Self {
            prepared: Arc::new(prepared),
            kind,
        })
    }

    /// The best sources for a target after some steps, as JSON: a list of steps with their mismatch.
    #[pyo3(signature = (steps, options, progress = None))]
    fn best(
        &self,
        py: Python<'_>,
        steps: &str,
        options: BestOptions,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let steps = steps_of(steps)?;
        let prepared = Arc::clone(&self.prepared);
        work::run(py, progress, move |progress| {
            let target = Target {
                plane: options.plane,
                shape: if options.square {
                    Shape::Square
                } else {
                    Shape::Circle
                },
                ..Target::new(DVec2::from_array(options.at), options.radius)
            };
            let search = SearchOptions {
                count: options.count,
                apart: options.apart,
                ..SearchOptions::default()
            };
            prepared.after(&steps, progress, |retouch| {
                let found = retouch.best(&target, &search, progress).map_err(raised)?;
                let found: Vec<_> = found
                    .iter()
                    .map(|found| {
                        json!({ "step": retouch.step(&target, found), "mismatch": found.mismatch })
                    })
                    .collect();
                serde_json::to_string(&found).map_err(of_task)
            })
        })
    }

    /// Pixels of the hole that are open after some steps.
    fn open_px(&self, py: Python<'_>, steps: &str) -> PyResult<usize> {
        let steps = steps_of(steps)?;
        let prepared = Arc::clone(&self.prepared);
        work::run(py, None, move |progress| {
            prepared.after(&steps, progress, |retouch| Ok(retouch.open_px()))
        })
    }

    /// The steps that fill what is open, after some steps: all of them as JSON.
    #[pyo3(signature = (steps, radius, square, progress = None))]
    fn fill(
        &self,
        py: Python<'_>,
        steps: &str,
        radius: Option<u32>,
        square: bool,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let steps = steps_of(steps)?;
        let prepared = Arc::clone(&self.prepared);
        work::run(py, progress, move |progress| {
            let options = FillOptions {
                radius_px: radius,
                shape: if square { Shape::Square } else { Shape::Circle },
                ..FillOptions::default()
            };
            prepared.after(&steps, progress, |retouch| {
                retouch.fill(&options, progress).map_err(raised)?;
                let steps: Vec<_> = retouch.steps().collect();
                serde_json::to_string(&steps).map_err(of_task)
            })
        })
    }

    /// The picture after some steps.
    fn picture(&self, py: Python<'_>, steps: &str) -> PyResult<Py<PyAny>> {
        let steps = steps_of(steps)?;
        let prepared = Arc::clone(&self.prepared);
        let image: AnyImage = work::run(py, None, move |progress| {
            prepared.after(&steps, progress, |retouch| {
                Ok(with_image!(&prepared.image, image => retouch.picture(image).into()))
            })
        })?;
        array::array(py, image, self.kind)
    }
}
