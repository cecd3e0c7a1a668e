//! A soft clip enhanced by a sharp photo of its plane.

use crate::exposure::{Exposure, Pair};
use crate::{Colors, VideoEditError, same_size};
use ravec_numeric::solve_positive;
use ravec_raster::{Image, Mask, Plane, ResizeFilter, Size, gaussian_blur, resize};

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
/// Blur of pictures that are compared, as standard deviation. Where one is sharper than the other, it has more contrast, which is no
/// matter of tone.
const COMPARED_BLUR_PX: f64 = 2.0;
/// Share of the pixels below a blur that must be usable.
const MIN_USABLE: f32 = 0.995;
/// Pairs of blurred pictures below which sharp ones are compared.
const MIN_BLURRED_PAIRS: usize = 400;

/// Curves of tone that bring the colors of a photo to those of a clip: a cubic polynomial for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone([[f32; TERMS]; 3]);

impl Tone {
    /// The tone that changes nothing.
    pub const SAME: Self = Self([[0.0, 1.0, 0.0, 0.0]; 3]);

    /// Fits the tone of `photo` to that of `target`, where `usable` is above 0.99. Both show the same in every pixel; one may be
    /// sharper.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn fit(photo: &Colors, target: &Colors, usable: &Plane) -> Result<Self, VideoEditError> {
        same_size(target.size(), photo.size())?;
        same_size(usable.size(), photo.size())?;
        let usable = Mask::from_fn(usable.size(), |col, row| usable[(col, row)] > 0.99);
        let pairs = pairs(photo, target, &usable);
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

/// Pairs of colors of two pictures that may differ in sharpness, at most [`MAX_PAIRS`].
fn pairs(plate: &Colors, frame: &Colors, usable: &Mask) -> Vec<Pair> {
    let blurred = |colors: &Colors| gaussian_blur(colors, COMPARED_BLUR_PX);
    let share = gaussian_blur(usable.coverage(), COMPARED_BLUR_PX);
    let found = sampled_pairs(&blurred(plate), &blurred(frame), &|col, row| {
        share[(col, row)] > MIN_USABLE
    });
    if found.len() < MIN_BLURRED_PAIRS {
        return sampled_pairs(plate, frame, &|col, row| usable.at(col, row) > 0.0);
    }
    found
}

/// Pairs of colors of two pictures in regular places, at most [`MAX_PAIRS`].
fn sampled_pairs(
    plate: &Colors,
    frame: &Colors,
    usable: &dyn Fn(usize, usize) -> bool,
) -> Vec<Pair> {
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
#[derive(Debug, Clone)]
pub struct Enhancement<'a> {
    /// sRGB-encoded colors, 0 to 1.
    pub frame: &'a Colors,
    /// Alpha of the foreground.
    pub alpha: &'a Plane,
    /// The photo on the plane in the view of the frame, in the tone of the plate, twice as large as the frame: colors of 0 to 1, and the
    /// share of the photo in each pixel.
    pub photo: Image<[f32; 4]>,
}

impl Enhancement<'_> {
    /// The frame twice as large: the photo on the plane, in the light of the frame, and the enlarged foreground before it.
    ///
    /// Beside the photo, one channel of this size is held at a time.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn result(self) -> Result<Colors, VideoEditError> {
        let Self {
            frame,
            alpha,
            mut photo,
        } = self;
        let (size, double) = (frame.size(), photo.size());
        same_size(alpha.size(), size)?;
        let expected = Size::new(2 * size.width(), 2 * size.height());
        if expected.ok() != Some(double) {
            return Err(VideoEditError::SizesDiffer {
                found: double,
                expected: size,
            });
        }
        let Foreground { exposure, colors } = Foreground::of(frame, alpha, &photo);
        let alpha = resize(alpha, double, ResizeFilter::CatmullRom);
        for channel in 0..3 {
            let enlarged = |colors: &Colors| {
                let plane = colors.map(|color| color[channel]);
                resize(&plane, double, ResizeFilter::CatmullRom)
            };
            // where the photo is not shown, the frame is enlarged
            let (front, frame) = (enlarged(&colors), enlarged(frame));
            let (gain, offset) = (exposure.gain[channel], exposure.offset[channel]);
            photo.for_each_row(|row, pixels| {
                let enlarged = front.row(row).iter().zip(frame.row(row));
                let rest = enlarged.zip(alpha.row(row));
                for (pixel, ((front, frame), alpha)) in pixels.iter_mut().zip(rest) {
                    let alpha = alpha.clamp(0.0, 1.0);
                    let shown = pixel[3].clamp(0.0, 1.0);
                    let sharp = gain * pixel[channel] + offset;
                    let front = front.clamp(0.0, alpha) + (1.0 - alpha) * sharp;
                    pixel[channel] = shown * front + (1.0 - shown) * frame;
                }
            });
        }
        drop(alpha);
        Ok(photo.map(|[r, g, b, _]| [r, g, b]))
    }
}

/// Foreground of a frame over the photo, at the size of the frame.
struct Foreground {
    /// Light of the frame against the photo.
    exposure: Exposure,
    /// Colors times alpha.
    colors: Colors,
}

impl Foreground {
    fn of(frame: &Colors, alpha: &Plane, photo: &Image<[f32; 4]>) -> Self {
        let size = frame.size();
        let small = [0, 1, 2, 3].map(|channel| {
            let plane = photo.map(|pixel| pixel[channel]);
            resize(&plane, size, ResizeFilter::Box)
        });
        let [red, green, blue, shown] = &small;
        let small = Image::from_fn(size, |col, row| {
            [red, green, blue].map(|plane| plane[(col, row)])
        });
        let near = Mask::from_fn(size, |col, row| alpha[(col, row)] > MAX_ALPHA).dilate(MARGIN_PX);
        let usable = Mask::from_fn(size, |col, row| {
            near.at(col, row) <= 0.0 && shown[(col, row)] > 0.99
        });
        let exposure = Exposure::fit(&pairs(&small, frame, &usable));
        let colors = Image::from_fn(size, |col, row| {
            let at = (col, row);
            if near.at(col, row) <= 0.0 {
                return [0.0; 3];
            }
            let alpha = alpha[at].clamp(0.0, 1.0);
            let (color, behind) = (frame[at], exposure.applied(small[at]));
            [0, 1, 2].map(|c| (color[c] - (1.0 - alpha) * behind[c]).clamp(0.0, alpha))
        });
        Self { exposure, colors }
    }
}
