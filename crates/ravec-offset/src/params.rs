//! What is asked for, and what is refused.

use ravec_mesh::Aabb;
use ravec_progress::Cancelled;

/// Which part of the surface at the distance.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// All points at the distance, on every side of every triangle.
    #[default]
    Both,
    /// The border of what can be reached from far away: cavities are filled.
    Outer,
    /// Inside the solid that the triangles enclose.
    Inner,
    /// Between the triangles and the surface inside: a hollow solid with walls of the distance.
    Shell,
}

/// Treatment of a mesh that is not closed.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum OpenRule {
    /// Refuse it where a side needs an inside.
    #[default]
    Refuse,
    /// Take the mesh for a sheet, open or closed, and make it as thick as the distance, on the side that its triangles face
    /// (that from which they are counterclockwise). The sheet is one skin of the result, the other is at the distance, and
    /// walls stand upright along its boundary. Where parts of the sheet are nearer to each other than the distance, the
    /// solids over them are one.
    Thicken,
}

/// The numbers that the coordinates of the result may be.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// Any.
    #[default]
    Double,
    /// Those that 32-bit floats hold, for files that have no others: all that is said of the result is true of it as it is
    /// written. The vertices of a mesh that become part of the result, as in a [`Side::Shell`], are rounded first.
    Single,
}

/// How to offset.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OffsetParams {
    /// The distance, in units of the mesh, above 0. With [`OpenRule::Thicken`] it may be below: the sheet becomes thick on
    /// the other side.
    pub distance: f64,
    /// How far the result may be off, in units of the mesh, above 0 and below half the distance.
    pub tolerance: f64,
    /// Which side (default both).
    pub side: Side,
    /// What to do with a mesh that is not closed (default refuse); to thicken it, `side` must be both.
    pub open: OpenRule,
    /// Whether to merge triangles as far as the tolerance allows, and to turn what then lies badly (default yes).
    pub simplify: bool,
    /// How far simplification may turn a triangle away from the surface that it stands for, in degrees, above 0 and at most 90
    /// (default what [`Self::normal_deviation_deg`] says). Triangles at creases that were off more before may stay so. Less keeps
    /// more triangles.
    ///
    /// Without a limit of their own, triangles may be turned by up to 80 % more: where the mesh is rough, as scans are (from
    /// triangle to triangle, three quarters of it bend by 4 radians or more along a way as long as its diagonal); and, in
    /// proportion, where more than a sixth of the triangles would be left. With a limit the surface is turned before its
    /// triangles are merged, which takes memory that [`Self::memory_bytes`] does not know of.
    pub max_normal_deviation_deg: Option<f64>,
    /// What the coordinates of the result may be (default double). Single precision asks for a tolerance of some 20 times
    /// the gap between its numbers there.
    pub coordinates: Coordinates,
    /// How much memory to use, in bytes (default as much as it takes). With less, space is cut into more tiles, which takes
    /// longer, and a surface that is too large is kept in a [`Storage`](crate::Storage); before simplification it is the same.
    /// Memory is guessed, and what is known of orders and borders is kept in any case, so that limits below some 200 MB may be
    /// exceeded by a half.
    pub memory_bytes: Option<u64>,
}

impl Default for OffsetParams {
    fn default() -> Self {
        Self {
            distance: 1.0,
            tolerance: 0.01,
            side: Side::default(),
            open: OpenRule::default(),
            simplify: true,
            max_normal_deviation_deg: None,
            coordinates: Coordinates::default(),
            memory_bytes: None,
        }
    }
}

/// Why there is no offset.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OffsetError {
    /// Nothing to be at a distance from.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// A mesh that is too small or too large to reckon with.
    #[error(
        "the mesh measures {} across, but only sizes from 1e-40 to 1e40 can be offset: scale it first",
        Short(*diagonal)
    )]
    Size {
        /// The diagonal of its box.
        diagonal: f64,
    },
    /// A distance that is none.
    #[error("the distance is {got}, but must be a number above 0")]
    Distance {
        /// Requested value.
        got: f64,
    },
    /// A distance that is too small or too large to reckon with.
    #[error("the distance is {}, but only sizes from 1e-40 to 1e40 can be offset", Short(*got))]
    DistanceSize {
        /// Requested value.
        got: f64,
    },
    /// A distance that leaves no room for a tolerance that can be kept.
    #[error("the distance is {}, but for a mesh of this size and place must be above {}", Short(*got), Short(*least))]
    DistanceTooSmall {
        /// Requested value.
        got: f64,
        /// What is too small just so.
        least: f64,
    },
    /// A tolerance that leaves nothing, or that numbers cannot hold.
    #[error(
        "the tolerance is {}, but must be at least {} and below half the distance, {}",
        Short(*got),
        Short(*least),
        Short(*most)
    )]
    Tolerance {
        /// Requested value.
        got: f64,
        /// The least for a mesh of this size.
        least: f64,
        /// Half the distance.
        most: f64,
    },
    /// A tolerance that 32-bit floats cannot hold.
    #[error(
        "the tolerance is {}, but must be at least {} for 32-bit floats to hold coordinates as large as these: write PLY, OBJ, \
         OFF or 3MF, which hold more, or move the mesh closer to the origin",
        Short(*got),
        Short(*least)
    )]
    SinglePrecision {
        /// Requested value.
        got: f64,
        /// The least for a mesh of this size and place.
        least: f64,
    },
    /// Coordinates that 32-bit floats do not reach.
    #[error(
        "coordinates of the result are beyond 3.4e38, where 32-bit floats end: write PLY, OBJ, OFF or 3MF, which hold more, \
         or scale the mesh"
    )]
    BeyondSinglePrecision,
    /// A normal deviation that is none.
    #[error("the normal deviation is {got} degrees, but must be above 0 and at most 90")]
    NormalDeviation {
        /// Requested value.
        got: f64,
    },
    /// Less memory than the mesh itself takes.
    #[error(
        "{} MiB of memory are not enough for this mesh: it takes at least {}", got >> 20, (least >> 20) + 1
    )]
    Memory {
        /// What was allowed, in bytes.
        got: u64,
        /// The least for this mesh, in bytes.
        least: u64,
    },
    /// The surface is larger than the memory it may take, and cannot be kept elsewhere.
    #[error("cannot keep the surface outside of memory: {cause}")]
    Storage {
        /// What the storage says.
        cause: String,
    },
    /// A sheet that is so rough, for its size, that what stands over its triangles has too many parts to be told apart.
    #[error(
        "the sheet is too rough to be thickened with a tolerance of {}: allow a larger one, or simplify or smooth the sheet first",
        Short(*tolerance)
    )]
    TooRough {
        /// Requested value.
        tolerance: f64,
    },
    /// A side that only solids have.
    #[error(
        "the mesh is not closed ({boundary_edges} boundary edges), so it has no inside: choose side both or outer, or close it first"
    )]
    NotClosed {
        /// Edges with a triangle on one side only.
        boundary_edges: u64,
    },
    /// A side of what is thickened.
    #[error(
        "a sheet is thickened on the side that its triangles face: side {side:?} does not go with it, choose both"
    )]
    SideOfSheet {
        /// Requested value.
        side: Side,
    },
    /// A sheet that turns into its own other side.
    #[error(
        "the sheet has one side only, like a Möbius strip (seen near {place}), so it has no front: cut it open there"
    )]
    OneSided {
        /// A place where its sides come together.
        place: glam::DVec3,
    },
    /// Nothing but triangles without area.
    #[error("all {triangles} triangles are without area, so the sheet has no side: mend it first")]
    NoArea {
        /// How many.
        triangles: u64,
    },
    /// Nothing is that deep inside, or nothing at all was found.
    #[error("no point of that side is {} away from the mesh: choose a smaller distance", Short(*distance))]
    Empty {
        /// Requested value.
        distance: f64,
    },
    /// The caller gave up.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Cells per side of the root that the tolerance may ask for: the lattice has 2²⁰.
const MOST_CELLS: f64 = 1_048_576.0;

/// The finest tolerance relative to the coordinates: some 2000 roundings.
const FINEST: f64 = 4e-13;

/// Sizes whose squares and cubes numbers can hold.
const SIZES: std::ops::Range<f64> = 1e-40..1e40;

/// A positive number, raised to three digits and by no more than [`MOST_RAISED`], so that a limit that is printed is one
/// that can be typed.
fn rounded_up(number: f64) -> f64 {
    // half a unit of the third digit is at most this much
    let digits = format!("{:.2e}", 1.005 * number);
    digits.parse().unwrap_or(number)
}

/// A bound for what rounding up to three digits adds.
const MOST_RAISED: f64 = 1.011;

/// A number in six digits at most.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let six = format!("{:.5e}", self.0);
        let short = six.parse().unwrap_or(self.0);
        if short == 0.0 || (1e-4..1e9).contains(&short.abs()) || !short.is_finite() {
            write!(f, "{short}")
        } else {
            write!(f, "{short:e}")
        }
    }
}

/// How far a triangle may be turned where the tolerance is [`COARSE`] or finer, in degrees.
const NORMAL_DEVIATION_DEG: f64 = 4.0;

/// The tolerance, relative to the distance, from which on triangles may be turned by more.
pub(crate) const COARSE: f64 = 0.05;

impl OffsetParams {
    /// How far simplification may turn a triangle, in degrees: what is asked for, or 4, and more where the tolerance ε is more
    /// than a twentieth of the distance δ: 4 √(20 ε/δ).
    ///
    /// A chord of a rounded edge, whose radius is the distance, is off by as much as the tolerance if it spans an angle that
    /// grows as √(ε/δ). A limit that does not grow with it would keep many more triangles than the tolerance asks for.
    pub fn normal_deviation_deg(&self) -> f64 {
        self.max_normal_deviation_deg.unwrap_or_else(|| {
            let coarseness = self.tolerance / (COARSE * self.distance);
            NORMAL_DEVIATION_DEG * coarseness.max(1.0).sqrt()
        })
    }

    /// Refuses what makes no sense for a mesh in a box.
    pub(crate) fn check(&self, bounds: &Aabb) -> Result<(), OffsetError> {
        let diagonal = bounds.diagonal();
        if diagonal > 0.0 && !SIZES.contains(&diagonal) {
            return Err(OffsetError::Size { diagonal });
        }
        let distance = self.distance;
        let reach = diagonal + 4.0 * distance;
        if !(distance.is_finite() && distance > 0.0) {
            return Err(OffsetError::Distance { got: distance });
        }
        if !SIZES.contains(&reach) {
            return Err(OffsetError::DistanceSize { got: distance });
        }
        // so that the lattice is fine enough, and places far from the origin still differ
        let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let of_numbers = rounded_up(farthest * FINEST);
        let least = rounded_up(reach * 3f64.sqrt() / MOST_CELLS).max(of_numbers);
        let most = 0.5 * distance;
        if least >= most {
            // the distance for which the two would be equal, were the first not rounded
            let of_lattice = 2.0 * 3f64.sqrt() * diagonal / (MOST_CELLS - 8.0 * 3f64.sqrt());
            let of_lattice = MOST_RAISED * of_lattice;
            return Err(OffsetError::DistanceTooSmall {
                got: distance,
                least: rounded_up(of_lattice).max(2.0 * of_numbers),
            });
        }
        let got = self.tolerance;
        if !(got.is_finite() && got >= least && got < most) {
            return Err(OffsetError::Tolerance { got, least, most });
        }
        if let Some(got) = self.max_normal_deviation_deg
            && !(got > 0.0 && got <= 90.0)
        {
            return Err(OffsetError::NormalDeviation { got });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_may_be_turned_by_more_where_the_tolerance_is_coarse() {
        let of = |tolerance, max_normal_deviation_deg| {
            let params = OffsetParams {
                distance: 2.0,
                tolerance,
                max_normal_deviation_deg,
                ..OffsetParams::default()
            };
            params.normal_deviation_deg()
        };
        assert!((of(0.001, None) - 4.0).abs() < 1e-12);
        assert!((of(0.1, None) - 4.0).abs() < 1e-12);
        assert!((of(0.4, None) - 8.0).abs() < 1e-12);
        assert!((of(0.4, Some(3.0)) - 3.0).abs() < 1e-12);
    }
}
