//! From a picture to a factored system, and from that to a deformation for every size.
//!
//! ```text
//! analyze: importance of units, straight runs           once a picture
//! factor the energies of x and y                         once a picture
//! for each size: sum up the minimum, bound the edges     about a millisecond, or some twenty
//! ```
//!
//! Cost: the analysis reads each pixel once and works on a reduction of 800 pixels otherwise; see `docs/measurements.md`.

use crate::analysis::{Analysis, units_for};
use crate::bounds::{Bounded, Edges, Format, State, minimize};
use crate::deformation::{Deformation, SolveSummary};
use crate::forms::{Content, GIVING, GridRun};
use crate::grid::{Edge, Grid};
use crate::importance::importance;
use crate::params::{Borders, RetargetError, RetargetParams};
use crate::quadtree::spans;
use crate::runs::straight_runs;
use crate::system::Axis;
use glam::{DVec2, dvec2};
use ravec_progress::{Phase, Progress};
use ravec_raster::{Color, Image, Mask, Resample, Size};
use rayon::prelude::*;
use std::sync::Arc;

/// The weight of a cell that a protecting mask touches.
pub(crate) const PROTECTED: f64 = 100.0;

/// The weight of a cell that may give way: a tenth of what is unimportant by itself.
pub(crate) const GIVEN_WAY: f64 = 0.1 * GIVING;

/// Share of a cell that must be painted to count as touched: a stray pixel of a soft brush does not.
const TOUCHED: f32 = 0.05;

/// The factor by which a side may change at most, either way.
const MAX_FACTOR: f64 = 20.0;

/// The bound on edges of deformations that are nearest to others, which are within [`PROVED_LENGTH`](crate::bounds::PROVED_LENGTH)
/// and seldom leave it. Above 0 nothing folds; more would blend with plain scaling more often.
const NEAREST_LENGTH: f64 = 0.01;

/// Overhang of free borders if no share is given.
const FREE_SHARE: f64 = 0.1;

/// Content of a picture as it is factored.
pub(crate) struct KnownContent {
    pub(crate) grid: Arc<Grid>,
    /// The weight of each cell.
    pub(crate) weights: Vec<f64>,
    pub(crate) runs: Vec<GridRun>,
    pub(crate) mean_importance: f64,
}

/// Masks painted on the picture, of its size.
#[derive(Debug, Clone, Copy, Default)]
pub struct Painted<'a> {
    /// Pixels that keep their shape.
    pub protect: Option<&'a Mask>,
    /// Pixels that may be squeezed or stretched first. Where both are painted, protection counts.
    pub give_way: Option<&'a Mask>,
}

/// Figures of the analysis.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AnalysisSummary {
    /// Cells of the grid.
    pub cells: usize,
    /// Unknowns of the system for x; that for y has about as many.
    pub unknowns: usize,
    /// Straight runs that are held straight.
    pub straight_runs: usize,
    /// The mean importance over the picture, 0 to 1, without what is painted.
    pub mean_importance: f64,
}

/// An analyzed picture, ready for any size.
#[derive(Debug, Clone)]
pub struct Retargeter {
    params: RetargetParams,
    grid: Arc<Grid>,
    /// The importance of each cell, with what is painted: 0.0025 to 100.
    weights: Arc<Vec<f64>>,
    runs: Arc<Vec<GridRun>>,
    axes: [Axis; 2],
    edge_lengths: Vec<f64>,
    summary: AnalysisSummary,
}

impl Retargeter {
    /// Analyses `image` and factors its energies.
    ///
    /// # Errors
    /// [`RetargetError::Parameter`] and [`RetargetError::MaskSize`] for what does not fit, [`RetargetError::Cancelled`] soon
    /// after `progress` is.
    pub fn new<P: Color + Resample>(
        image: &Image<P>,
        painted: Painted<'_>,
        params: &RetargetParams,
        progress: &Progress,
    ) -> Result<Self, RetargetError> {
        params.check()?;
        check_masks(image.size(), painted)?;
        let phase = progress.phase("analyze", 4);
        let units = units_for(image.size(), params.grid_cells);
        let analysis = Analysis::new(image, units, progress)?;
        phase.advance(1);
        Self::of_analysis(image.size(), &analysis, painted, params, &phase, progress)
    }

    /// Finds the lines and the importance of an analyzed picture of a size, and factors its energies.
    fn of_analysis(
        size: Size,
        analysis: &Analysis,
        painted: Painted<'_>,
        params: &RetargetParams,
        phase: &Phase,
        progress: &Progress,
    ) -> Result<Self, RetargetError> {
        let units = analysis.units;
        let found = if params.line_strength > 0.0 {
            straight_runs(&analysis.image)
        } else {
            Vec::new()
        };
        let importance = importance(analysis, &found, params.saliency);
        progress.check()?;
        phase.advance(1);
        let runs: Vec<GridRun> = found
            .iter()
            .map(|run| GridRun::new(run, analysis.unit_px as f64, units))
            .collect();
        let mean_importance = importance.iter().sum::<f64>() / importance.len() as f64;
        let weights = unit_weights(&importance, painted, units);
        let grid = if params.adaptive {
            let symmetric = params.borders == Borders::Symmetric;
            let spans = spans(analysis, &weights, &runs, symmetric, progress)?;
            Grid::new(size, units, |col, row| spans[row * units[0] + col])
        } else {
            Grid::new(size, units, |_, _| 1)
        };
        progress.check()?;
        phase.advance(1);
        let weights = cell_means(&grid, &weights);
        let content = KnownContent {
            grid: Arc::new(grid),
            weights,
            runs,
            mean_importance,
        };
        let found = Self::from_content(params, content, false)?;
        progress.check()?;
        phase.advance(1);
        Ok(found)
    }

    /// Factors the energies of content that is known. With `keep`, [`nearest`](Self::nearest) can be asked.
    pub(crate) fn from_content(
        params: &RetargetParams,
        content: KnownContent,
        keep: bool,
    ) -> Result<Self, RetargetError> {
        let KnownContent {
            grid,
            weights,
            runs,
            mean_importance,
        } = content;
        let axes = Axis::both(
            &Content {
                grid: &grid,
                weights: &weights,
                runs: &runs,
                line_strength: params.line_strength,
                free_borders: params.borders == Borders::Free,
            },
            params.borders,
            keep,
        )?;
        let edge_lengths = grid
            .edges
            .iter()
            .map(|edge| {
                let [[x0, y0], [x1, y1]] = edge.ends.map(|end| grid.vertices[end as usize]);
                (x1 - x0 + y1 - y0) as f64
            })
            .collect();
        Ok(Self {
            params: params.clone(),
            summary: AnalysisSummary {
                cells: grid.cells.len(),
                unknowns: axes[0].unknowns.count(),
                straight_runs: runs.len(),
                mean_importance,
            },
            grid,
            weights: Arc::new(weights),
            runs: Arc::new(runs),
            axes,
            edge_lengths,
        })
    }

    /// Figures of the analysis.
    pub fn summary(&self) -> &AnalysisSummary {
        &self.summary
    }

    /// The deformation that makes the picture `size`.
    ///
    /// # Errors
    /// [`RetargetError::Factor`] if a side changes by a factor of more than 20.
    pub fn solve(&self, size: Size) -> Result<Deformation, RetargetError> {
        self.solve_from(size, self.params.object_scale, None)
    }

    /// As [`solve`](Self::solve), with another scale of important content.
    pub(crate) fn solve_scaled(
        &self,
        size: Size,
        scale: f64,
    ) -> Result<Deformation, RetargetError> {
        self.solve_from(size, scale, None)
    }

    /// The deformation for `size`, starting from one for a similar size: for following a frame that is being dragged. Takes a
    /// quarter of the time and is as free of folds, but not yet the best; [`solve`](Self::solve) when the frame stands.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn solve_near(
        &self,
        size: Size,
        similar: &Deformation,
    ) -> Result<Deformation, RetargetError> {
        let same_grid = Arc::ptr_eq(&similar.grid, &self.grid);
        let warm = similar.state.as_ref().filter(|_| same_grid);
        self.solve_from(size, self.params.object_scale, warm)
    }

    fn solve_from(
        &self,
        size: Size,
        scale: f64,
        warm: Option<&State>,
    ) -> Result<Deformation, RetargetError> {
        check_factor(self.grid.image_size, size)?;
        let new = as_vector(size);
        let crop = self.best_crop(new);
        let format = self.format(crop.whole, scale);
        let edges = Edges {
            edges: &self.grid.edges,
            lengths: &self.edge_lengths,
        };
        let found = minimize(&self.axes, &edges, &format, warm);
        let vertices = self.positions(&found, crop.whole);
        let mut deformation = Deformation {
            size,
            vertices: vertices.into_iter().map(|at| at - crop.first).collect(),
            grid: self.grid.clone(),
            weights: self.weights.clone(),
            runs: self.runs.clone(),
            state: found.state,
            summary: SolveSummary {
                width: size.width(),
                height: size.height(),
                object_scale: format.scale,
                bounded_edges: found.active,
                steps: found.steps,
                plain_share: found.blend,
                cropped: 1.0 - (new / crop.whole).min_element(),
                least_area: 0.0,
            },
        };
        deformation.summary.least_area = deformation.least_area();
        Ok(deformation)
    }

    /// The vertices of the deformation whose edges are as near to `edges` as the energy lets them be, in its own measure, starting from
    /// those of `found` for a regular grid; without folds. The factor of the energy must have been kept.
    pub(crate) fn nearest(&self, found: &Deformation, edges: &[DVec2]) -> Vec<DVec2> {
        let grid = &self.grid;
        let edge = |k: usize| {
            let [from, to] = grid.edges[k].ends.map(|end| found.vertices[end as usize]);
            to - from
        };
        let unit_px = grid.unit_px();
        let mut weights = vec![0.0; grid.edges.len()];
        for (k, weight) in edge_weights(grid, &self.weights).into_iter().enumerate() {
            let unit = unit_px[usize::from(!grid.edges[k].across)];
            weights[k] = weight / (unit * unit);
        }
        let steps = [0, 1].map(|a: usize| {
            let axis = &self.axes[a];
            let change: Vec<f64> = (0..edges.len()).map(|k| edges[k][a] - edge(k)[a]).collect();
            let mut step = vec![0.0; axis.unknowns.count()];
            axis.change_edges(&change, &weights, &mut step);
            step
        });
        let factor = as_vector(found.size) / as_vector(grid.image_size);
        let mut vertices: Vec<DVec2> = (0..grid.vertices.len() as u32)
            .map(|vertex| {
                let step = [0, 1].map(|a: usize| self.axes[a].unknowns.value(&steps[a], vertex));
                let at = found.vertices[vertex as usize] + DVec2::from_array(step);
                self.framed(vertex, at, as_vector(found.size))
            })
            .collect();
        let bounds = Edges {
            edges: &grid.edges,
            lengths: &self.edge_lengths,
        };
        let components = [0, 1].map(|a: usize| {
            let ends = grid.edges.iter().map(|edge| edge.ends);
            ends.map(|[from, to]| vertices[to as usize][a] - vertices[from as usize][a])
                .collect()
        });
        let slack = bounds.min_slack(&components, factor * unit_px);
        if slack < NEAREST_LENGTH {
            let blend = ((NEAREST_LENGTH - slack) / (1.0 - slack)).min(1.0);
            for (vertex, at) in vertices.iter_mut().enumerate() {
                *at = at.lerp(grid.position_px(vertex as u32) * factor, blend);
            }
        }
        vertices
    }

    /// A place of a vertex, where it is on a border: on the frame, or beyond it if borders are free.
    fn framed(&self, vertex: u32, mut at: DVec2, size: DVec2) -> DVec2 {
        if self.params.borders == Borders::Free {
            for axis in 0..2 {
                match self.grid.vertices[vertex as usize][axis] {
                    0 => at[axis] = at[axis].min(0.0),
                    last if last == self.grid.units[axis] => at[axis] = at[axis].max(size[axis]),
                    _ => {}
                }
            }
        }
        at
    }

    /// The scale of important content and the mean units for a picture of a new size.
    fn format(&self, new: DVec2, scale: f64) -> Format {
        let factor = new / as_vector(self.grid.image_size);
        let share = match self.params.borders {
            Borders::Free if self.params.max_crop > 0.0 => self.params.max_crop,
            Borders::Free => FREE_SHARE,
            _ => 0.0,
        };
        Format {
            size: new,
            scale: scale.clamp(factor.min_element(), factor.max_element()),
            mean_unit: factor * self.grid.unit_px(),
            // half the share at each side
            overhang: 0.5 * share / (1.0 - share) * new,
        }
    }

    /// Positions of the vertices in a picture of the size `whole`.
    fn positions(&self, found: &Bounded, whole: DVec2) -> Vec<DVec2> {
        let factor = whole / as_vector(self.grid.image_size);
        (0..self.grid.vertices.len() as u32)
            .map(|vertex| {
                let at = DVec2::from_array(
                    [0, 1].map(|a| self.axes[a].unknowns.value(&found.z[a], vertex)),
                );
                if found.blend > 0.0 {
                    at.lerp(self.grid.position_px(vertex) * factor, found.blend)
                } else {
                    at
                }
            })
            .collect()
    }
}

/// Crop of the result: the picture becomes `whole`, of which the part from `first` on is shown.
struct Crop {
    whole: DVec2,
    first: DVec2,
}

/// Number of trial sizes between no crop and the greatest, and of trial places for each.
const CROP_TRIALS: usize = 8;

/// Cost of a lost cell relative to the cost of squeezing it to nothing. At 1 nothing would ever be cut off that is as
/// important as the rest, however strongly all of it is squeezed; at 0 as much as possible would.
const LOST: f64 = 0.25;

impl Retargeter {
    /// The crop along the side that shrinks more which has the least energy, what is lost included.
    fn best_crop(&self, new: DVec2) -> Crop {
        let none = Crop {
            whole: new,
            first: DVec2::ZERO,
        };
        let factor = new / as_vector(self.grid.image_size);
        let axis = usize::from(factor.y < factor.x);
        if self.params.max_crop <= 0.0
            || self.params.borders == Borders::Free
            || factor.x == factor.y
        {
            return none;
        }
        let energy = |whole: DVec2| {
            let scale = self.format(whole, self.params.object_scale).scale;
            self.axes[0].min_energy(whole.x, scale) + self.axes[1].min_energy(whole.y, scale)
        };
        let mut best = (energy(new), none);
        for trial in 1..=CROP_TRIALS {
            let share = self.params.max_crop * trial as f64 / CROP_TRIALS as f64;
            let mut whole = new;
            // no more than what makes both factors one
            whole[axis] = (new[axis] / (1.0 - share))
                .min(factor[1 - axis] * as_vector(self.grid.image_size)[axis]);
            let scale = self.format(whole, self.params.object_scale).scale;
            let z = self.axes[axis].unbounded(whole[axis], scale);
            let spare = whole[axis] - new[axis];
            let within = energy(whole);
            for place in 0..=CROP_TRIALS {
                let first = spare * place as f64 / CROP_TRIALS as f64;
                let lost: f64 = self
                    .grid
                    .cells
                    .iter()
                    .zip(self.weights.iter())
                    .map(|(cell, weight)| {
                        let corners = cell.corners.map(|c| self.axes[axis].unknowns.value(&z, c));
                        let center = 0.25 * corners.iter().sum::<f64>() - first;
                        let [width, height] = self.grid.extent(cell);
                        let gone = center < 0.0 || center > new[axis];
                        f64::from(u8::from(gone)) * weight * (width * height) as f64
                    })
                    .sum();
                // each of its two edges along the axis falls short by the whole scale
                let total = within + LOST * 2.0 * scale * scale * lost;
                if total < best.0 {
                    let mut from = DVec2::ZERO;
                    from[axis] = first;
                    best = (total, Crop { whole, first: from });
                }
            }
        }
        best.1
    }
}

/// Refuses a size that is too far from the old one.
pub(crate) fn check_factor(image: Size, target: Size) -> Result<(), RetargetError> {
    let factor = as_vector(target) / as_vector(image);
    if factor.max_element() > MAX_FACTOR || factor.min_element() < 1.0 / MAX_FACTOR {
        return Err(RetargetError::Factor { image, target });
    }
    Ok(())
}

/// Refuses masks of another size than the picture.
pub(crate) fn check_masks(image: Size, painted: Painted<'_>) -> Result<(), RetargetError> {
    for (which, mask) in [("protect", painted.protect), ("give-way", painted.give_way)] {
        if let Some(mask) = mask.filter(|mask| mask.size() != image) {
            return Err(RetargetError::MaskSize {
                which,
                got: mask.size(),
                image,
            });
        }
    }
    Ok(())
}

pub(crate) fn as_vector(size: Size) -> DVec2 {
    dvec2(size.width() as f64, size.height() as f64)
}

/// The weight of each unit from its importance and from what is painted.
fn unit_weights(importance: &[f64], painted: Painted<'_>, units: [usize; 2]) -> Vec<f64> {
    let mut weights: Vec<f64> = importance.iter().map(|&b| weight_of(b)).collect();
    for (mask, weight) in [(painted.give_way, GIVEN_WAY), (painted.protect, PROTECTED)] {
        let Some(mask) = mask else { continue };
        for (value, touched) in weights.iter_mut().zip(touched(mask, units)) {
            if touched {
                *value = weight;
            }
        }
    }
    weights
}

/// The weight of a unit of an importance, 0 to 1.
pub(crate) fn weight_of(importance: f64) -> f64 {
    GIVING + (1.0 - GIVING) * importance
}

/// For each unit whether a mask touches it.
pub(crate) fn touched(mask: &Mask, [cols, rows]: [usize; 2]) -> Vec<bool> {
    (0..cols * rows)
        .into_par_iter()
        .map(|unit| {
            let (col, row) = (unit % cols, unit / cols);
            let part = |k: usize, count: usize, length: usize| {
                let first = k * length / count;
                first..((k + 1) * length).div_ceil(count).min(length)
            };
            let columns = part(col, cols, mask.size().width());
            part(row, rows, mask.size().height()).any(|y| {
                mask.coverage().row(y)[columns.clone()]
                    .iter()
                    .any(|&c| c > TOUCHED)
            })
        })
        .collect()
}

/// For each edge of a regular grid the weights of the cells beside it.
fn edge_weights(grid: &Grid, weights: &[f64]) -> Vec<f64> {
    let [cols, rows] = grid.units;
    let weight = |col: usize, row: usize| weights[row * cols + col];
    let beside = |edge: &Edge| {
        let [col, row] = grid.vertices[edge.ends[0] as usize];
        let (before, after) = if edge.across {
            (
                (row > 0).then(|| weight(col, row - 1)),
                (row < rows).then(|| weight(col, row)),
            )
        } else {
            (
                (col > 0).then(|| weight(col - 1, row)),
                (col < cols).then(|| weight(col, row)),
            )
        };
        before.unwrap_or(0.0) + after.unwrap_or(0.0)
    };
    grid.edges.iter().map(beside).collect()
}

/// The mean over the units of each cell; a protected unit protects its cell.
fn cell_means(grid: &Grid, units: &[f64]) -> Vec<f64> {
    grid.cells
        .iter()
        .map(|cell| {
            let [width, height] = grid.extent(cell);
            let [col, row] = cell.first;
            let values = (row..row + height)
                .flat_map(|y| (col..col + width).map(move |x| units[y * grid.units[0] + x]));
            values.sum::<f64>() / (width * height) as f64
        })
        .collect()
}
