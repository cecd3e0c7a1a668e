//! The area on which the frames of an animation are painted.

use ravec_raster::{Image, Sample, Size, Srgba};

/// Treatment of the painted area before the next frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dispose {
    /// Stays.
    Keep,
    /// Becomes transparent.
    Clear,
    /// Becomes as it was before.
    Restore,
}

/// A frame as it is stored: a rectangle, clipped to the canvas.
pub(super) struct Patch<'a, T: Sample> {
    /// Column and row of its first pixel.
    pub at: (usize, usize),
    /// Columns.
    pub width: usize,
    /// Pixels, row by row.
    pub pixels: &'a [Srgba<T>],
    /// True to paint over what is there, by alpha; false to replace it.
    pub over: bool,
    /// Disposal after the frame.
    pub dispose: Dispose,
}

/// The shown picture, and what becomes of it.
pub(super) struct Canvas<T: Sample> {
    image: Image<Srgba<T>>,
    /// Area of the last patch, and what becomes of it before the next.
    pending: Option<Pending<T>>,
}

struct Pending<T: Sample> {
    at: (usize, usize),
    width: usize,
    rows: usize,
    dispose: Dispose,
    before: Vec<Srgba<T>>,
}

impl<T: Sample> Canvas<T> {
    pub fn new(size: Size) -> Self {
        Self {
            image: Image::new(size, Srgba([T::default(); 4])),
            pending: None,
        }
    }

    /// Paints the next frame and gives the picture that is shown.
    pub fn paint(&mut self, patch: &Patch<'_, T>) -> &Image<Srgba<T>> {
        self.dispose();
        let (width, height) = (self.image.width(), self.image.height());
        let (col, row) = (patch.at.0.min(width), patch.at.1.min(height));
        let rows = patch.pixels.len().checked_div(patch.width).unwrap_or(0);
        let shown_width = patch.width.min(width - col);
        let shown_rows = rows.min(height - row);
        let mut pending = Pending {
            at: (col, row),
            width: shown_width,
            rows: shown_rows,
            dispose: patch.dispose,
            before: Vec::new(),
        };
        for at in 0..shown_rows {
            let target = &mut self.image.row_mut(row + at)[col..col + shown_width];
            if patch.dispose == Dispose::Restore {
                pending.before.extend_from_slice(target);
            }
            let source = &patch.pixels[at * patch.width..][..shown_width];
            for (target, source) in target.iter_mut().zip(source) {
                *target = if patch.over {
                    over(*source, *target)
                } else {
                    *source
                };
            }
        }
        self.pending = Some(pending);
        &self.image
    }

    fn dispose(&mut self) {
        let Some(pending) = self.pending.take() else {
            return;
        };
        for at in 0..pending.rows {
            let (col, row) = (pending.at.0, pending.at.1 + at);
            let target = &mut self.image.row_mut(row)[col..col + pending.width];
            match pending.dispose {
                Dispose::Keep => {}
                Dispose::Clear => target.fill(Srgba([T::default(); 4])),
                Dispose::Restore => {
                    target.copy_from_slice(&pending.before[at * pending.width..][..pending.width]);
                }
            }
        }
    }
}

/// Straight alpha compositing of encoded colors, as the PNG specification has it.
fn over<T: Sample>(source: Srgba<T>, target: Srgba<T>) -> Srgba<T> {
    let alpha = source.0[3].to_unit();
    if alpha >= 1.0 {
        return source;
    }
    if alpha <= 0.0 {
        return target;
    }
    let rest = target.0[3].to_unit() * (1.0 - alpha);
    let sum = alpha + rest;
    let mut mixed = target;
    for channel in 0..3 {
        let color = source.0[channel].to_unit() * alpha + target.0[channel].to_unit() * rest;
        mixed.0[channel] = T::from_unit(color / sum);
    }
    mixed.0[3] = T::from_unit(sum);
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Srgba<u8> = Srgba([255, 0, 0, 255]);
    const BLUE: Srgba<u8> = Srgba([0, 0, 255, 255]);
    const CLEAR: Srgba<u8> = Srgba([0; 4]);

    fn patch(at: (usize, usize), pixels: &[Srgba<u8>], dispose: Dispose) -> Patch<'_, u8> {
        Patch {
            at,
            width: pixels.len(),
            pixels,
            over: true,
            dispose,
        }
    }

    #[test]
    fn patches_are_kept_cleared_or_taken_back() {
        let mut canvas = Canvas::new(Size::new(3, 1).unwrap());
        let shown = canvas.paint(&patch((0, 0), &[RED; 3], Dispose::Keep));
        assert_eq!(shown.pixels(), [RED, RED, RED]);
        let shown = canvas.paint(&patch((1, 0), &[BLUE], Dispose::Restore));
        assert_eq!(shown.pixels(), [RED, BLUE, RED]);
        let shown = canvas.paint(&patch((2, 0), &[BLUE], Dispose::Clear));
        assert_eq!(shown.pixels(), [RED, RED, BLUE]);
        let shown = canvas.paint(&patch((0, 0), &[CLEAR], Dispose::Keep));
        assert_eq!(shown.pixels(), [RED, RED, CLEAR]);
    }

    #[test]
    fn patches_outside_of_the_canvas_are_clipped() {
        let mut canvas = Canvas::new(Size::new(2, 1).unwrap());
        for at in [(0, 7), (7, 0), (usize::MAX, usize::MAX)] {
            let shown = canvas.paint(&patch(at, &[RED; 4], Dispose::Restore));
            assert_eq!(shown.pixels(), [CLEAR, CLEAR]);
        }
        let shown = canvas.paint(&patch((1, 0), &[RED; 4], Dispose::Restore));
        assert_eq!(shown.pixels(), [CLEAR, RED]);
        let shown = canvas.paint(&patch((0, 0), &[], Dispose::Restore));
        assert_eq!(shown.pixels(), [CLEAR, CLEAR]);
    }
}
