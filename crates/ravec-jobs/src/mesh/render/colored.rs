//! Distances as colors.

use super::Params;
use crate::error::JobError;
use crate::report::Report;
use ravec::mesh_io::MeshFile;
use ravec::mesh_render::{ColorMap, Paint, Values};

/// Records the least, greatest and mean distance.
pub(super) fn summarize(distances: &[f64], report: &mut Report) {
    let fold = |start: f64, pick: fn(f64, f64) -> f64| distances.iter().copied().fold(start, pick);
    report.figures.extend([
        ("distance_min", fold(f64::INFINITY, f64::min)),
        ("distance_max", fold(0.0, f64::max)),
        (
            "distance_mean",
            distances.iter().sum::<f64>() / distances.len().max(1) as f64,
        ),
    ]);
}

/// Numbers at vertices and the scale on which they are shown.
pub(super) struct Colored {
    values: Vec<f64>,
    map: ColorMap,
    range: Option<[f64; 2]>,
}

impl Colored {
    /// Shares are of the diagonal of the mesh to which distances were measured: what is 2% away from it stays so, however
    /// large the mesh is that lies there.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for a length in a unit, if the file of that mesh does not name its own.
    pub(super) fn new(
        mut values: Vec<f64>,
        reference: &MeshFile,
        params: &Params,
    ) -> Result<Self, JobError> {
        let (diagonal, unit) = (reference.mesh.bounds().diagonal(), reference.unit);
        let end = params
            .range
            .map(|range| range.resolve("range", diagonal, unit));
        let end = end.transpose()?;
        let Some(expected) = params.expected else {
            let most = values.iter().copied().fold(0.0, f64::max);
            return Ok(Self {
                values,
                map: ColorMap::Sequential,
                range: Some([0.0, end.unwrap_or(most)]),
            });
        };
        let expected = expected.resolve("expected", diagonal, unit)?;
        for value in &mut values {
            *value -= expected;
        }
        Ok(Self {
            values,
            map: ColorMap::Diverging,
            range: end.map(|end| [-end, end]),
        })
    }

    pub(super) fn paint(&self) -> Paint<'_> {
        Paint::VertexValues(Values {
            values: &self.values,
            map: self.map,
            range: self.range,
        })
    }
}
