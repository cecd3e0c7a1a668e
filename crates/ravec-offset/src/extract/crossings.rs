//! Points at which the surface crosses edges, cached between rounds.

use crate::domain::Region;
use crate::grow::{CornerValue, Ends, ON_SURFACE, Refinement, Sample, root};
use crate::surface::TRIANGLES_AT_ONCE;
use glam::DVec3;
use ravec_octree::{Corner, Polygon};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashMap};
use std::hash::BuildHasher as _;

/// Everything that the crossing of an edge depends on: its ends, the inner one first.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    ends: [Corner; 2],
    region: Region,
    values: [CornerValue; 2],
    /// The inner end is a filled corner, outside by its value.
    is_filled: bool,
}

impl Crossing {
    fn of(refinement: &Refinement<'_>, polygon: &Polygon) -> Self {
        let (ends, cells) = (polygon.ends(), polygon.cells());
        let region = cells
            .iter()
            .map(|&cell| refinement.tree.data(cell).region)
            .find(|&region| region != Region::Unknown)
            .unwrap_or(Region::Unknown);
        let hint = refinement.tree.data(cells[0]).hint;
        let field = refinement.setting.field;
        let mut values = ends.map(|end| {
            refinement.corner(end).copied().unwrap_or_else(|| {
                // a corner of finer, empty cells, which other tiles may know
                let p = refinement.setting.frame.point(end);
                let near = field.near(p, hint);
                let side = match region {
                    Region::Unknown => field.region(p),
                    known => known,
                };
                CornerValue {
                    triangle: near.triangle,
                    value: field.value(near.distance, side),
                }
            })
        });
        // a filled corner: the surface is as close to it as possible
        let is_filled = values[0].value > 0.0;
        values[0].value = values[0].value.min(-1e-9 * refinement.setting.tolerance);
        Self {
            ends,
            region,
            values,
            is_filled,
        }
    }

    /// Hash of the crossing except for its ends.
    fn mark(&self) -> u64 {
        let values = self.values.map(|at| (at.triangle, at.value.to_bits()));
        FxBuildHasher.hash_one((self.region, values, self.is_filled))
    }

    fn root(&self, refinement: &Refinement<'_>) -> Sample {
        let points = self.ends.map(|end| refinement.setting.frame.point(end));
        let enough = ON_SURFACE * refinement.setting.tolerance;
        let mut sample = if self.is_filled {
            let near = refinement
                .setting
                .field
                .near(points[0], self.values[0].triangle);
            Sample {
                point: points[0],
                away: near.away,
                triangle: near.triangle,
            }
        } else {
            let ends = Ends {
                points,
                values: self.values,
                // for some ends, only the sign is known
                known: &[],
            };
            root(refinement.setting.field, self.region, ends, enough)
        };
        // off the ends, where other edges begin
        let along = points[1] - points[0];
        let t = (sample.point - points[0]).dot(along) / along.length_squared();
        let margin = refinement.setting.grid.margin(1e-6, along.length());
        let place = points[0] + t.clamp(margin, 1.0 - margin) * along;
        sample.point = refinement.setting.grid.nearest(place);
        sample
    }
}

/// Crossings of edges and positions of vertices that depend on several of them; rounds of repair need them repeatedly.
#[derive(Debug, Default)]
pub(crate) struct CrossingCache {
    /// Crossings by the ends of their edge, each with the hash of its other inputs.
    crossings: FxHashMap<[Corner; 2], (u64, Sample)>,
    /// Vertices of leaves with several, by a hash of the leaf and the crossings of its edges.
    pub(super) vertices: FxHashMap<u64, DVec3>,
    /// Vertices in faces, by a hash of the leaves on both sides and the crossings of both polygons.
    pub(super) in_faces: FxHashMap<u64, DVec3>,
}

impl CrossingCache {
    /// Computes the crossings of the edges of some polygons.
    pub(super) fn fill<'p>(
        &mut self,
        refinement: &Refinement<'_>,
        polygons: impl ParallelIterator<Item = &'p Polygon>,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let missing: Vec<(Crossing, Sample)> = polygons
            .map(|polygon| Crossing::of(refinement, polygon))
            .filter(|crossing| {
                let known = self.crossings.get(&crossing.ends);
                known.is_none_or(|(mark, _)| *mark != crossing.mark())
            })
            .map(|crossing| {
                progress.check()?;
                Ok((crossing, crossing.root(refinement)))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.crossings.reserve(missing.len());
        for some in missing.chunks(TRIANGLES_AT_ONCE as usize) {
            progress.check()?;
            let named = some
                .iter()
                .map(|(crossing, place)| (crossing.ends, (crossing.mark(), *place)));
            self.crossings.extend(named);
        }
        Ok(())
    }

    pub(super) fn of(&self, polygon: &Polygon) -> Sample {
        self.crossings[&polygon.ends()].1
    }
}
