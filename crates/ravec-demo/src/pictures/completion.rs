//! Posts before a house front and a floor, taken away.

use super::Demo;
use crate::error::bug;
use crate::page::Figure;
use glam::DVec2;
use ravec::completion::{
    CompleteError, CompleteParams, FillOptions, FragmentIndex, Retouch, Sources, complete,
};
use ravec::raster::{Image, Mask, Size, Srgb};
use ravec_jobs::JobError;
use ravec_scenes::Seed;
use ravec_scenes::occlusion::{Surface, occluded};

impl Demo<'_> {
    /// Posts before a house front and a floor, taken away with and without the perspective.
    pub fn completion(&mut self, max_side: usize, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "Removing an object",
            "The place of an object is filled with pieces from the rest of the picture. Where a plane is known, such as a front or a \
             floor, pieces are copied in its perspective: windows get the right size and courses the right slant. In these drawn \
             scenes the hidden ground is known, so that the error can be measured.",
        );
        let width = max_side.clamp(96, 420);
        let size = Size::new(width, width * 3 / 4).expect("both sides are positive");
        for (surface, figure) in [
            (Surface::Windows, "front_completed_error_steps"),
            (Surface::Tiles, "floor_completed_error_steps"),
        ] {
            let scene = occluded(surface, size, seed);
            let hole = Mask::from_fn(size, |col, row| scene.post.at(col, row) > 0.0);
            let picture = scene.picture.convert::<Srgb<u8>>();
            let params = CompleteParams::default();
            let filled =
                |planes: &[[DVec2; 4]]| complete(&picture, &hole, planes, &params, self.progress);
            let failed = |cause| match cause {
                CompleteError::Cancelled(_) => JobError::Cancelled,
                other => bug("the hole in a scene", &other),
            };
            let (flat, plane) = self.report.time("complete", || {
                let flat = filled(&[]).map_err(failed)?.image;
                let plane = filled(&[scene.corners_in_image]).map_err(failed)?.image;
                Ok::<_, JobError>((flat, plane))
            })?;
            let corners = [scene.corners_in_image];
            let (by_fragments, steps) = self.report.time("fragments", || {
                let sources = Sources {
                    planes: &corners,
                    ..Sources::new(&picture, &hole)
                };
                let index = FragmentIndex::new(&sources, self.progress).map_err(failed)?;
                let mut retouch = Retouch::new(&index);
                let done = retouch
                    .fill(&FillOptions::default(), self.progress)
                    .map_err(failed)?;
                Ok::<_, JobError>((retouch.picture(&picture), done.steps))
            })?;
            let truth = scene.background.convert::<Srgb<u8>>();
            let [with, without, pieced] =
                [&plane, &flat, &by_fragments].map(|filled| error_steps(filled, &truth, &hole));
            self.report.figures.insert(figure, with);
            let before = || Figure::picture(&picture.convert(), "before");
            let after = |image: &Image<Srgb<u8>>| Figure::picture(&image.convert(), "after");
            let off = |steps: f64| format!("{steps:.1} of 255 steps off (root mean square)");
            let figures = [
                Figure::compared(
                    before(),
                    after(&plane),
                    "The post, removed in the perspective of the plane",
                )
                .with_note(off(with)),
                Figure::compared(
                    before(),
                    after(&by_fragments),
                    "The same, filled by larger fragments one by one, each of which can be exchanged",
                )
                .with_note(format!("{steps} fragments; {}", off(pieced))),
                Figure::compared(
                    before(),
                    after(&flat),
                    "For comparison: without the plane, pieces have the wrong size and slant",
                )
                .with_note(off(without)),
            ];
            self.page.figures(&figures);
        }
        Ok(())
    }
}

/// The root of the mean squared difference in a hole, in 8-bit steps.
fn error_steps(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>, hole: &Mask) -> f64 {
    let covered = hole
        .coverage()
        .pixels()
        .iter()
        .zip(a.pixels().iter().zip(b.pixels()));
    let (mut sum, mut count) = (0.0, 0.0f64);
    for (_, (a, b)) in covered.filter(|(coverage, _)| **coverage > 0.0) {
        for c in 0..3 {
            sum += f64::from(a.0[c].abs_diff(b.0[c])).powi(2);
            count += 1.0;
        }
    }
    (sum / count.max(1.0)).sqrt()
}
