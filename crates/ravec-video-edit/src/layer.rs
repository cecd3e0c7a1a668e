//! The foreground of a frame as a layer, and what is put behind or before it.

use crate::{Colors, VideoEditError, same_size};
use ravec_planar::{Beyond, Homography, warp};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Plane, Size};

/// sRGB-encoded colors times alpha, and alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer(Image<[f32; 4]>);

impl Layer {
    /// The foreground of a frame: what its background does not explain. `background` is the plate as the frame shows it.
    ///
    /// Over its own background the layer gives the frame, up to colors that would leave 0 to 1. The difference has less error at soft
    /// rims than estimated foreground colors have.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn new(frame: &Colors, alpha: &Plane, background: &Colors) -> Result<Self, VideoEditError> {
        same_size(alpha.size(), frame.size())?;
        same_size(background.size(), frame.size())?;
        Ok(Self(Image::from_fn(frame.size(), |col, row| {
            let at = (col, row);
            let alpha = alpha[at].clamp(0.0, 1.0);
            let (color, behind) = (frame[at], background[at]);
            let [r, g, b] =
                [0, 1, 2].map(|c| (color[c] - (1.0 - alpha) * behind[c]).clamp(0.0, alpha));
            [r, g, b, alpha]
        })))
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.0.size()
    }

    /// Colors times alpha, and alpha.
    pub fn pixels(&self) -> &Image<[f32; 4]> {
        &self.0
    }

    /// The layer seen through a map into a picture of `size`. Beyond the layer there is nothing.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn warped(
        &self,
        layer_from_output: &Homography,
        size: Size,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let nothing = Beyond::Pixel([0.0; 4]);
        let warped = warp(&self.0, layer_from_output, size, nothing, progress)?;
        // the kernel overshoots
        Ok(Self(warped.map(|[r, g, b, alpha]| {
            let alpha = alpha.clamp(0.0, 1.0);
            let [r, g, b] = [r, g, b].map(|value| value.clamp(0.0, alpha));
            [r, g, b, alpha]
        })))
    }

    /// The layer without the parts that `front` hides, 0 to 1.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn behind(&self, front: &Plane) -> Result<Self, VideoEditError> {
        same_size(front.size(), self.size())?;
        Ok(Self(Image::from_fn(self.size(), |col, row| {
            let share = 1.0 - front[(col, row)].clamp(0.0, 1.0);
            self.0[(col, row)].map(|value| share * value)
        })))
    }

    /// The layer over a picture.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn over(&self, background: &Colors) -> Result<Colors, VideoEditError> {
        same_size(background.size(), self.size())?;
        Ok(Image::from_fn(self.size(), |col, row| {
            let [r, g, b, alpha] = self.0[(col, row)];
            let behind = background[(col, row)];
            [
                r + (1.0 - alpha) * behind[0],
                g + (1.0 - alpha) * behind[1],
                b + (1.0 - alpha) * behind[2],
            ]
        }))
    }
}

/// The share of light that a contact shadow of a layer leaves, 0 to 1.
///
/// The shadow is the alpha of the layer, flattened by the factor `squash` toward its lowest row of more than half alpha, and blurred by
/// `softness_px`; `strength` is the share of light that it takes at most.
pub fn contact_shadow(layer: &Layer, squash: f32, softness_px: f64, strength: f32) -> Plane {
    let alpha = layer.0.map(|[_, _, _, alpha]| alpha);
    let height = alpha.height();
    let bottom = (0..height)
        .rev()
        .find(|&row| alpha.row(row).iter().any(|&alpha| alpha > 0.5));
    let Some(bottom) = bottom else {
        return Plane::new(alpha.size(), 1.0);
    };
    // each row of the shadow shows the row of the layer that squashing moves there
    let flat = Plane::from_fn(alpha.size(), |col, row| {
        let above = bottom as f32 - row as f32;
        let source = bottom as f32 - above / squash.max(0.01);
        if source < 0.0 || source > (height - 1) as f32 {
            return 0.0;
        }
        alpha[(col, source as usize)]
    });
    let soft = ravec_raster::gaussian_blur(&flat, softness_px.max(0.1));
    soft.map(|share| 1.0 - strength * share.clamp(0.0, 1.0))
}
