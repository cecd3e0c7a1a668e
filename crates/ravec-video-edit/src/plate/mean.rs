//! The second pass: means of the samples near the modes.

use super::modes::biweight;
use super::on_plane::{Geometry, OnPlane, Stabilized, exposure_of, pairs_of};
use super::surroundings::surrounded;
use super::{Plate, ShotFrame};
use crate::VideoEditError;
use crate::exposure::Exposure;
use ravec_raster::{Image, Mask, Plane};
use rayon::prelude::*;

/// Share of samples near the mode below which a mean would be of little, and the mode itself is taken.
const MIN_WEIGHT: f32 = 0.05;

/// The second pass over the frames of a shot.
pub struct PlateModes {
    geometry: Geometry,
    /// Radius around a mode in which samples agree with it.
    radius: f32,
    /// Color of each mode; 0 in the last channel where nothing was seen.
    modes: Image<[f32; 4]>,
    /// Weighted sums of the samples that agree, and their weight.
    sums: Image<[f32; 4]>,
    /// Weighted sum of the squared distances of these samples to the mode, a channel.
    squares: Plane,
    /// Number of samples.
    samples: Plane,
    /// Exposure of the reference frame.
    reference: Exposure,
}

impl PlateModes {
    /// Starts the second pass with the modes of the first one, whose samples agree within `radius`.
    pub(super) fn new(geometry: Geometry, modes: Image<[f32; 4]>, radius: f32) -> Self {
        let size = geometry.plate;
        Self {
            geometry,
            radius,
            modes,
            sums: Image::new(size, [0.0; 4]),
            squares: Plane::new(size, 0.0),
            samples: Plane::new(size, 0.0),
            reference: Exposure::SAME,
        }
    }

    /// Takes the next frame.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add(&mut self, frame: &ShotFrame<'_>) -> Result<(), VideoEditError> {
        Self::add_planes(std::slice::from_mut(self), &[Some(*frame)])
    }

    /// Takes the next frame of a shot of several planes, as [`PlateSamples::add_planes`](super::PlateSamples::add_planes) does.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add_planes(
        planes: &mut [Self],
        frames: &[Option<ShotFrame<'_>>],
    ) -> Result<(), VideoEditError> {
        let mut on_planes = Vec::new();
        for (plane, (modes, frame)) in planes.iter().zip(frames).enumerate() {
            let Some(frame) = frame else {
                continue;
            };
            let stabilized = modes.geometry.stabilized(frame)?;
            let pairs = pairs_of(&stabilized, |col, row| {
                let [r, g, b, known] = modes.modes[(col, row)];
                (known > 0.0).then_some([r, g, b])
            });
            on_planes.push(OnPlane {
                plane,
                frame,
                stabilized,
                pairs,
            });
        }
        let exposure = exposure_of(&on_planes);
        for on in on_planes {
            planes[on.plane].take(on.frame, &on.stabilized, exposure);
        }
        Ok(())
    }

    /// Adds a frame that lies on the plate.
    fn take(&mut self, frame: &ShotFrame<'_>, stabilized: &Stabilized, exposure: Exposure) {
        if frame.is_reference {
            self.reference = exposure;
        }
        let scale = 1.0 / (self.radius * self.radius);
        self.sums
            .par_rows_mut()
            .zip(self.samples.par_rows_mut().zip(self.squares.par_rows_mut()))
            .zip(self.modes.par_rows().zip(stabilized.par_rows()))
            .for_each(|((sums, (samples, squares)), (modes, stabilized))| {
                let counts = samples.iter_mut().zip(squares);
                for (((sums, (samples, squares)), mode), [r, g, b, share]) in
                    sums.iter_mut().zip(counts).zip(modes).zip(stabilized)
                {
                    if *share == 0.0 {
                        continue;
                    }
                    let color = exposure.undone([*r, *g, *b]);
                    let distance = [0, 1, 2].map(|c| color[c] - mode[c]);
                    let weight = biweight(distance, scale);
                    let square: f32 = distance.iter().map(|value| value * value).sum();
                    *squares += weight * square / 3.0;
                    for (sum, value) in sums.iter_mut().zip(color) {
                        *sum += weight * value;
                    }
                    sums[3] += weight;
                    *samples += 1.0;
                }
            });
    }

    /// The plate.
    pub fn plate(self) -> Plate {
        let size = self.geometry.plate;
        let seen = |col: usize, row: usize| self.modes[(col, row)][3] > 0.0;
        let colors = Image::from_fn(size, |col, row| {
            let [r, g, b, _] = self.modes[(col, row)];
            let [sr, sg, sb, weight] = self.sums[(col, row)];
            let color = if weight > MIN_WEIGHT {
                [sr, sg, sb].map(|sum| sum / weight)
            } else {
                [r, g, b]
            };
            self.reference
                .applied(color)
                .map(|value| value.clamp(0.0, 1.0))
        });
        let agreement = Plane::from_fn(size, |col, row| {
            let (count, weight) = (self.samples[(col, row)], self.sums[(col, row)][3]);
            if seen(col, row) && count > 0.0 {
                (weight / count).min(1.0)
            } else {
                0.0
            }
        });
        let certainty = Plane::from_fn(size, |col, row| {
            let weight = self.sums[(col, row)][3];
            agreement[(col, row)] * weight / (weight + 1.0)
        });
        let spread = Plane::from_fn(size, |col, row| {
            let weight = self.sums[(col, row)][3];
            if seen(col, row) && weight > MIN_WEIGHT {
                (self.squares[(col, row)] / weight).sqrt()
            } else {
                0.0
            }
        });
        let seen = Mask::from_fn(size, seen);
        let colors = surrounded(&colors, &seen);
        Plate {
            colors,
            seen,
            certainty,
            spread,
            agreement,
            samples: self.samples,
        }
    }
}
