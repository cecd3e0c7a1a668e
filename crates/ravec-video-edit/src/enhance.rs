//! A soft clip enhanced by a sharp photo of its plane.

use crate::exposure::{Exposure, Pair};
use crate::{Colors, VideoEditError, same_size};
use ravec_numeric::solve_positive;
use ravec_raster::{Image, Mask, Plane, ResizeFilter, Size, resize};

/// Degree of the curves of tone.
const TERMS: usize = 4;
/// Rounds of reweighting.
const ROUNDS: usize = 6;
/// Limit of Tukey's biweight in standard deviations.
const TUKEY: f32 = 4.685;
/// Pixels that are compared, at most.
const MAX_PAIRS: usize = 40_000;
/// Weight that bends a curve toward a line, relative to the number of pairs.
const STIFFNESS: f64 = 1e-5;
/// Alpha below which a pixel shows background alone.
const MAX_ALPHA: f32 = 0.012;
/// Pixels between the foreground and those that are compared.
const MARGIN_PX: f64 = 3.0;

/// Curves of tone that bring the colors of a photo to those of a clip: a cubic polynomial for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone([[f32; TERMS]; 3]);

impl Tone {
    /// The tone that changes nothing.
    pub const SAME: Self = Self([[0.0, 1.0, 0.0, 0.0]; 3]);

    /// Fits the tone of `photo` to that of `target`, where `usable` is above 0.99. Both show the same in every pixel.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn fit(photo: &Colors, target: &Colors, usable: &Plane) -> Result<Self, VideoEditError> {
        same_size(target.size(), photo.size())?;
        same_size(usable.size(), photo.size())?;
        let pairs = pairs(photo, target, &|col, row| usable[(col, row)] > 0.99);
        let mut tone = Self::SAME;
        if pairs.len() < 10 * TERMS {
            return Ok(tone);
        }
        for round in 0..ROUNDS {
            let scale = [0, 1, 2].map(|c| {
                let sizes = pairs
                    .iter()
                    .map(|pair| tone.residual(pair, c).abs())
                    .collect();
                (1.4826 * crate::exposure::median(sizes)).max(0.5 / 255.0)
            });
            let Some(next) = tone.refitted(&pairs, scale, round > 0) else {
                break;
            };
            tone = next;
        }
        Ok(tone)
    }

    /// A color in this tone.
    pub fn applied(&self, color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| {
            self.0[c]
                .iter()
                .rev()
                .fold(0.0, |sum, term| sum * color[c] + term)
        })
    }

    fn residual(&self, pair: &Pair, channel: usize) -> f32 {
        pair.frame[channel] - self.applied(pair.plate)[channel]
    }

    fn refitted(&self, pairs: &[Pair], scale: [f32; 3], weighted: bool) -> Option<Self> {
        let mut tone = *self;
        for (channel, scale) in scale.into_iter().enumerate() {
            let mut matrix = [[0.0f64; TERMS]; TERMS];
            let mut right = [0.0f64; TERMS];
            for pair in pairs {
                let residual = self.residual(pair, channel) / (TUKEY * scale);
                let share = if weighted {
                    (1.0 - residual * residual).max(0.0)
                } else {
                    1.0
                };
                let weight = f64::from(share * share);
                let x = f64::from(pair.plate[channel]);
                let powers = [1.0, x, x * x, x * x * x];
                for (a, power) in powers.iter().enumerate() {
                    right[a] += weight * power * f64::from(pair.frame[channel]);
                    for (b, other) in powers.iter().enumerate() {
                        matrix[a][b] += weight * power * other;
                    }
                }
            }
            for (term, row) in matrix.iter_mut().enumerate() {
                let pull = if term > 1 {
                    STIFFNESS * pairs.len() as f64
                } else {
                    1e-9
                };
                row[term] += pull;
            }
            tone.0[channel] = solve_positive(&matrix, &right)?.map(|value| value as f32);
        }
        Some(tone)
    }
}

/// Pairs of colors of two pictures, at most [`MAX_PAIRS`].
fn pairs(plate: &Colors, frame: &Colors, usable: &dyn Fn(usize, usize) -> bool) -> Vec<Pair> {
    let step = (plate.size().pixels() / MAX_PAIRS).isqrt().max(1);
    let mut pairs = Vec::new();
    for row in (step / 2..plate.height()).step_by(step) {
        for col in (step / 2..plate.width()).step_by(step) {
            if usable(col, row) {
                let (plate, frame) = (plate[(col, row)], frame[(col, row)]);
                pairs.push(Pair { plate, frame });
            }
        }
    }
    pairs
}

/// A frame that is enhanced.
#[derive(Debug, Clone, Copy)]
pub struct Enhancement<'a> {
    /// sRGB-encoded colors, 0 to 1.
    pub frame: &'a Colors,
    /// Alpha of the foreground.
    pub alpha: &'a Plane,
    /// The photo on the plane in the view of the frame, in the tone of the plate, twice as large as the frame.
    pub photo: &'a Colors,
    /// Share of the photo in each of its pixels.
    pub shown: &'a Plane,
}

impl Enhancement<'_> {
    /// The frame twice as large: the photo on the plane, in the light of the frame, and the enlarged foreground before it.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn result(&self) -> Result<Colors, VideoEditError> {
        let size = self.frame.size();
        let double = self.photo.size();
        same_size(self.alpha.size(), size)?;
        same_size(self.shown.size(), double)?;
        let expected = Size::new(2 * size.width(), 2 * size.height());
        if expected.ok() != Some(double) {
            return Err(VideoEditError::SizesDiffer {
                found: double,
                expected: size,
            });
        }
        let small = resized(self.photo, size, ResizeFilter::Box);
        let small_shown = resize(self.shown, size, ResizeFilter::Box);
        let near =
            Mask::from_fn(size, |col, row| self.alpha[(col, row)] > MAX_ALPHA).dilate(MARGIN_PX);
        let usable =
            |col: usize, row: usize| near.at(col, row) <= 0.0 && small_shown[(col, row)] > 0.99;
        let exposure = Exposure::fit(&pairs(&small, self.frame, &usable));
        let lit = small.map(|color| exposure.applied(color));
        // what the photo does not explain, enlarged, over the photo
        let rest = Image::from_fn(size, |col, row| {
            let at = (col, row);
            let alpha = self.alpha[at].clamp(0.0, 1.0);
            let (color, behind) = (self.frame[at], lit[at]);
            if near.at(col, row) <= 0.0 {
                return [0.0; 3];
            }
            [0, 1, 2].map(|c| (color[c] - (1.0 - alpha) * behind[c]).clamp(0.0, alpha))
        });
        let rest = resized(&rest, double, ResizeFilter::CatmullRom);
        let alpha = resize(self.alpha, double, ResizeFilter::CatmullRom);
        // where the photo is not shown, the frame is enlarged; in place, for pictures of this size are large
        let mut result = resized(self.frame, double, ResizeFilter::CatmullRom);
        result.for_each_row(|row, out| {
            for (col, out) in out.iter_mut().enumerate() {
                let at = (col, row);
                let alpha = alpha[at].clamp(0.0, 1.0);
                let (sharp, shown) = (
                    exposure.applied(self.photo[at]),
                    self.shown[at].clamp(0.0, 1.0),
                );
                *out = [0, 1, 2].map(|c| {
                    let front = rest[at][c].clamp(0.0, alpha) + (1.0 - alpha) * sharp[c];
                    shown * front + (1.0 - shown) * out[c]
                });
            }
        });
        Ok(result)
    }
}

fn resized(colors: &Colors, size: Size, filter: ResizeFilter) -> Colors {
    let planes = [0, 1, 2].map(|c| resize(&colors.map(|color| color[c]), size, filter));
    Image::from_fn(size, |col, row| {
        planes.each_ref().map(|plane| plane[(col, row)])
    })
}
