//! Viewpoints and planes of cuts as people give them.

use super::Length;
use crate::error::JobError;
use glam::DVec3;
use ravec::mesh::TriMesh;
use ravec::mesh_io::LengthUnit;
use ravec::mesh_render::View;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Viewpoint of a picture of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Viewpoint(pub View);

/// The text is no viewpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a view is front, right, back, left, top, bottom, iso, or degrees around and up, as in 30,20; up is -90 to 90"
)]
pub struct ViewpointError;

impl FromStr for Viewpoint {
    type Err = ViewpointError;

    fn from_str(text: &str) -> Result<Self, ViewpointError> {
        if let Some(view) = View::from_name(text) {
            return Ok(Self(view));
        }
        match numbers(text)?[..] {
            [azimuth, elevation] if (-90.0..=90.0).contains(&elevation) => {
                Ok(Self(View::new(azimuth, elevation)))
            }
            _ => Err(ViewpointError),
        }
    }
}

impl From<NoNumber> for ViewpointError {
    fn from(_: NoNumber) -> Self {
        Self
    }
}

impl fmt::Display for Viewpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match View::NAMED.iter().find(|(_, view)| *view == self.0) {
            Some((name, _)) => f.pad(name),
            None => write!(f, "{},{}", self.0.azimuth_deg, self.0.elevation_deg),
        }
    }
}

impl TryFrom<String> for Viewpoint {
    type Error = ViewpointError;

    fn try_from(text: String) -> Result<Self, ViewpointError> {
        text.parse()
    }
}

impl From<Viewpoint> for String {
    fn from(view: Viewpoint) -> Self {
        view.to_string()
    }
}

/// A plane that cuts a mesh open, and the side of it that is taken away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Cut {
    /// The direction along which places are counted, of any length but 0.
    along: [f64; 3],
    /// True to remove the part before the plane instead of the part beyond it; along an axis only.
    before: bool,
    /// Position of the plane: a coordinate in that direction, or a share of what the mesh reaches.
    at: Length,
}

/// The text is no plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a section is x, y, z or a direction as in 1,1,0, with a minus sign for the other side, and where, as in x=2.5 or -y=40%"
)]
pub struct CutError;

impl Cut {
    /// The unit normal toward the side that is taken away, and the position of the plane along it.
    ///
    /// `None` if the plane is nowhere: the direction is 0, or the mesh is empty and the place a share.
    ///
    /// # Errors
    /// [`JobError::Parameter`] if the place has a unit and that of the mesh is unknown.
    pub fn plane(
        &self,
        mesh: &TriMesh,
        unit: Option<LengthUnit>,
    ) -> Result<Option<(DVec3, f64)>, JobError> {
        let Some(along) = DVec3::from_array(self.along).try_normalize() else {
            return Ok(None);
        };
        let at = match self.at {
            Length::Percent(percent) => {
                let corners = mesh.triangles().iter().flatten();
                let places = corners.map(|&v| along.dot(mesh.positions()[v as usize]));
                let none = (f64::INFINITY, f64::NEG_INFINITY);
                let (low, high) = places.fold(none, |(low, high), at| (low.min(at), high.max(at)));
                low + percent / 100.0 * (high - low)
            }
            // independent of the diagonal
            length => length.resolve("section", 0.0, unit)?,
        };
        let (normal, offset) = if self.before {
            (-along, -at)
        } else {
            (along, at)
        };
        Ok(offset.is_finite().then_some((normal, offset)))
    }
}

const AXES: [(&str, [f64; 3]); 3] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
];

impl FromStr for Cut {
    type Err = CutError;

    fn from_str(text: &str) -> Result<Self, CutError> {
        let text = text.trim();
        let (direction, at) = match text.split_once('=') {
            Some((direction, at)) => (direction.trim(), at.parse().map_err(|_| CutError)?),
            None => (text, Length::Percent(50.0)),
        };
        let axis = |name: &str| AXES.iter().find(|(known, _)| *known == name);
        let (along, before) = match direction.strip_prefix('-').and_then(axis) {
            Some((_, along)) => (*along, true),
            None => match axis(direction) {
                Some((_, along)) => (*along, false),
                None => match numbers(direction)?[..] {
                    [x, y, z] if [x, y, z] != [0.0; 3] => ([x, y, z], false),
                    _ => return Err(CutError),
                },
            },
        };
        Ok(Self { along, before, at })
    }
}

impl From<NoNumber> for CutError {
    fn from(_: NoNumber) -> Self {
        Self
    }
}

impl fmt::Display for Cut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.before { "-" } else { "" };
        if let Some((name, _)) = AXES.iter().find(|(_, along)| *along == self.along) {
            write!(f, "{sign}{name}={}", self.at)
        } else {
            let [x, y, z] = self.along;
            write!(f, "{x},{y},{z}={}", self.at)
        }
    }
}

impl TryFrom<String> for Cut {
    type Error = CutError;

    fn try_from(text: String) -> Result<Self, CutError> {
        text.parse()
    }
}

impl From<Cut> for String {
    fn from(cut: Cut) -> Self {
        cut.to_string()
    }
}

/// A part of a list is no finite number.
struct NoNumber;

/// Finite numbers with commas between them.
fn numbers(text: &str) -> Result<Vec<f64>, NoNumber> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>());
    let finite = |number: f64| {
        if number.is_finite() {
            Ok(number)
        } else {
            Err(NoNumber)
        }
    };
    parts
        .map(|number| number.map_err(|_| NoNumber).and_then(finite))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::cuboid;

    #[test]
    fn viewpoints_have_names_or_angles_and_read_as_they_were_written() {
        assert_eq!("top".parse(), Ok(Viewpoint(View::TOP)));
        assert_eq!("30,-20.5".parse(), Ok(Viewpoint(View::new(30.0, -20.5))));
        for text in ["front", "iso", "12.5,90", "-700,0"] {
            let view: Viewpoint = text.parse().unwrap();
            assert_eq!(view.to_string(), text);
        }
        for wrong in ["", "up", "30", "30,91", "1,2,3", "nan,0"] {
            assert_eq!(wrong.parse::<Viewpoint>(), Err(ViewpointError), "{wrong}");
        }
    }

    #[test]
    fn planes_are_found_on_the_mesh() {
        let mesh = cuboid([2.0, 4.0, 6.0].into()).mesh;
        let mesh_at = |text: &str| {
            text.parse::<Cut>()
                .unwrap()
                .plane(&mesh, None)
                .unwrap()
                .unwrap()
        };
        for (text, normal, offset) in [
            ("x", DVec3::X, 0.0),
            ("z=25%", DVec3::Z, -1.5),
            ("-y=1.5", -DVec3::Y, -1.5),
            ("-y=75%", -DVec3::Y, -1.0),
            ("0,0,-2=1", -DVec3::Z, 1.0),
            ("0,3,0=100%", DVec3::Y, 2.0),
        ] {
            assert_eq!(mesh_at(text), (normal, offset), "{text}");
            let cut: Cut = text.parse().unwrap();
            assert_eq!(cut.to_string().parse(), Ok(cut), "{text}");
        }
        let nowhere: Cut = "x".parse().unwrap();
        let none = TriMesh::default();
        assert_eq!(nowhere.plane(&none, None).unwrap(), None);
        for wrong in ["", "w", "x=", "0,0,0", "1,2=3", "--x", "x=1=2"] {
            assert_eq!(wrong.parse::<Cut>(), Err(CutError), "{wrong}");
        }
    }
}
