//! The model parts of a 3MF file.

use std::io::{BufRead, BufReader};

use glam::{DAffine3, DVec3};
use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use ravec_progress::Progress;
use rustc_hash::FxHashMap;

use super::super::error::{Place, ReadMeshError};
use super::super::number::{integer, number, shown};
use super::super::read::{MeshLimits, ReadWarning};
use super::super::{LengthUnit, MeshFormat};
use super::package::Part;

/// A use of an object.
pub(super) struct Use {
    /// The part it is in, if not in the same.
    pub(super) path: Option<String>,
    pub(super) object: u32,
    pub(super) parent_from_object: DAffine3,
}

/// A mesh or a collection of uses, or both.
#[derive(Default)]
pub(super) struct Object {
    pub(super) positions: Vec<DVec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) components: Vec<Use>,
}

/// One part.
pub(super) struct Model {
    pub(super) unit: LengthUnit,
    pub(super) objects: FxHashMap<u32, Object>,
    /// What is built.
    pub(super) items: Vec<Use>,
    pub(super) warnings: Vec<ReadWarning>,
}

/// How many vertices and triangles all objects of all parts may have.
pub(super) struct Room {
    limits: MeshLimits,
    vertices: u64,
    triangles: u64,
}

impl Room {
    pub(super) fn new(limits: &MeshLimits) -> Self {
        Self {
            limits: *limits,
            vertices: 0,
            triangles: 0,
        }
    }

    fn vertex(&mut self) -> Result<(), ReadMeshError> {
        self.vertices += 1;
        if self.vertices > self.limits.max_vertices {
            return Err(ReadMeshError::TooMany {
                what: "vertices",
                limit: self.limits.max_vertices,
            });
        }
        Ok(())
    }

    fn triangle(&mut self) -> Result<(), ReadMeshError> {
        self.triangles += 1;
        if self.triangles > self.limits.max_triangles {
            return Err(ReadMeshError::TooMany {
                what: "triangles",
                limit: self.limits.max_triangles,
            });
        }
        Ok(())
    }
}

/// The target of the relation of the root to the model.
pub(super) fn root_of(relations: impl BufRead) -> Option<String> {
    let mut reader = Reader::from_reader(relations);
    let mut buffer = Vec::new();
    loop {
        buffer.clear();
        match reader.read_event_into(&mut buffer).ok()? {
            Event::Start(tag) | Event::Empty(tag) => {
                let (mut target, mut is_model) = (None, false);
                for attribute in tag.attributes().with_checks(false).flatten() {
                    match attribute.key.local_name().as_ref() {
                        "Target" => {
                            target = attribute.normalized_value(XmlVersion::Implicit1_0).ok();
                        }
                        "Type" => is_model = attribute.value.ends_with("/3dmodel"),
                        _ => {}
                    }
                }
                if is_model && let Some(target) = target {
                    return Some(target.into_owned());
                }
            }
            Event::Eof => return None,
            _ => {}
        }
    }
}

/// Reads the part called `name`. Fails with [`ReadMeshError::Cancelled`] soon after a cancellation; if the part grows too
/// large, tells so by the error inside.
pub(super) fn read_part(
    part: BufReader<Part<'_>>,
    name: &str,
    room: &mut Room,
    progress: &Progress,
) -> Result<Model, Result<ReadMeshError, TooLarge>> {
    let mut reader = Reader::from_reader(part);
    let mut builder = Builder {
        name,
        model: Model {
            unit: LengthUnit::Millimeter,
            objects: FxHashMap::default(),
            items: Vec::new(),
            warnings: Vec::new(),
        },
        open: None,
        room,
        place: Place::Byte(0),
    };
    let mut buffer = Vec::new();
    let (mut depth, mut events) = (0_u64, 0_u64);
    loop {
        events += 1;
        if events.is_multiple_of(4096) {
            progress.check().map_err(|cancelled| Ok(cancelled.into()))?;
        }
        buffer.clear();
        builder.place = Place::Byte(reader.buffer_position());
        let event = match reader.read_event_into(&mut buffer) {
            Ok(event) => event,
            Err(error) => {
                let place = Place::Byte(reader.error_position());
                if reader.get_ref().get_ref().too_large {
                    return Err(Err(TooLarge));
                }
                builder.place = place;
                return Err(Ok(builder.fault(error.to_string())));
            }
        };
        match event {
            Event::Start(tag) => {
                depth += 1;
                builder.start(&tag).map_err(Ok)?;
            }
            Event::Empty(tag) => {
                builder.start(&tag).map_err(Ok)?;
                builder.end(tag.local_name().as_ref());
            }
            Event::End(tag) => {
                depth = depth.saturating_sub(1);
                builder.end(tag.local_name().as_ref());
            }
            Event::Eof if depth > 0 => {
                return Err(Ok(ReadMeshError::Truncated {
                    format: MeshFormat::ThreeMf,
                    place: Place::Byte(reader.buffer_position()),
                    inside: format!("the part {}", shown(name.as_bytes())),
                }));
            }
            Event::Eof => break,
            _ => {}
        }
    }
    Ok(builder.model)
}

/// The part is larger than the limit of bytes allows.
pub(super) struct TooLarge;

struct Builder<'a> {
    name: &'a str,
    model: Model,
    /// The object that has begun, and its number.
    open: Option<(u32, Object)>,
    room: &'a mut Room,
    /// Where the last tag begins.
    place: Place,
}

impl Builder<'_> {
    fn fault(&self, what: impl std::fmt::Display) -> ReadMeshError {
        let name = shown(self.name.as_bytes());
        let what = format!("in the part {name}: {what}");
        ReadMeshError::syntax(MeshFormat::ThreeMf, self.place, what)
    }

    fn ignore(&mut self, what: &'static str) {
        let warning = ReadWarning::Ignored { what };
        if !self.model.warnings.contains(&warning) {
            self.model.warnings.push(warning);
        }
    }

    fn start(&mut self, tag: &BytesStart<'_>) -> Result<(), ReadMeshError> {
        match tag.local_name().as_ref() {
            "vertex" => self.vertex(tag),
            "triangle" => self.triangle(tag),
            "model" => self.model(tag),
            "object" => {
                let mut id = None;
                self.attributes(tag, |key, value| {
                    if key == "id" {
                        id = index(value);
                    }
                })?;
                let id = id.ok_or_else(|| self.fault("an object has no number for its id"))?;
                self.open = Some((id, Object::default()));
                Ok(())
            }
            "component" => {
                let component = self.a_use(tag)?;
                match &mut self.open {
                    Some((_, object)) => object.components.push(component),
                    None => return Err(self.fault("a component stands outside of any object")),
                }
                Ok(())
            }
            "item" => {
                let item = self.a_use(tag)?;
                self.model.items.push(item);
                Ok(())
            }
            "basematerials" | "colorgroup" | "texture2dgroup" | "multiproperties"
            | "compositematerials" => {
                self.ignore("materials and colors");
                Ok(())
            }
            "beamlattice" => {
                self.ignore("beam lattices");
                Ok(())
            }
            "slicestack" => {
                self.ignore("slices");
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn end(&mut self, name: &str) {
        if name == "object"
            && let Some((id, object)) = self.open.take()
        {
            self.model.objects.insert(id, object);
        }
    }

    /// Calls `each` with the names, less the prefix, and the values of a tag's attributes.
    fn attributes(
        &self,
        tag: &BytesStart<'_>,
        mut each: impl FnMut(&str, &str),
    ) -> Result<(), ReadMeshError> {
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| self.fault(error))?;
            each(attribute.key.local_name().as_ref(), &attribute.value);
        }
        Ok(())
    }

    fn model(&mut self, tag: &BytesStart<'_>) -> Result<(), ReadMeshError> {
        let mut unit = None;
        let mut required = String::new();
        let mut spaces: Vec<(String, String)> = Vec::new();
        self.attributes(tag, |key, value| match key {
            "unit" => unit = Some(value.to_owned()),
            "requiredextensions" => value.clone_into(&mut required),
            _ => spaces.push((key.to_owned(), value.to_owned())),
        })?;
        if let Some(unit) = unit {
            let known = LengthUnit::ALL
                .into_iter()
                .find(|known| known.name() == unit);
            self.model.unit = known.ok_or_else(|| {
                let unit = shown(unit.as_bytes());
                self.fault(format!("`{unit}` is not a unit of length"))
            })?;
        }
        let changes_the_shape = |prefix: &str| {
            let space = spaces.iter().find(|(key, _)| key == prefix);
            !space.is_some_and(|(_, name)| {
                name.contains("/material/") || name.contains("/production/")
            })
        };
        if required.split_ascii_whitespace().any(changes_the_shape) {
            self.ignore("extensions that the file requires, perhaps for its shape");
        }
        Ok(())
    }

    fn vertex(&mut self, tag: &BytesStart<'_>) -> Result<(), ReadMeshError> {
        let mut at = [None; 3];
        self.attributes(tag, |key, value| {
            let axis = match key {
                "x" => 0,
                "y" => 1,
                "z" => 2,
                _ => return,
            };
            at[axis] = number(value.trim_ascii().as_bytes());
        })?;
        let [Some(x), Some(y), Some(z)] = at else {
            return Err(self.fault("a vertex lacks a number for x, y or z"));
        };
        let at = DVec3::new(x, y, z);
        if self.open.is_none() {
            return Err(self.fault("a vertex stands outside of any object"));
        }
        if !at.is_finite() {
            return Err(ReadMeshError::NotFinite {
                format: MeshFormat::ThreeMf,
                place: self.place,
                vertex: self.room.vertices,
                at: at.to_array(),
            });
        }
        self.room.vertex()?;
        if let Some((_, object)) = &mut self.open {
            object.positions.push(at);
        }
        Ok(())
    }

    fn triangle(&mut self, tag: &BytesStart<'_>) -> Result<(), ReadMeshError> {
        let mut corners = [None; 3];
        self.attributes(tag, |key, value| {
            let which = match key {
                "v1" => 0,
                "v2" => 1,
                "v3" => 2,
                _ => return,
            };
            corners[which] = index(value);
        })?;
        let [Some(a), Some(b), Some(c)] = corners else {
            return Err(self.fault("a triangle lacks an index for v1, v2 or v3"));
        };
        self.room.triangle()?;
        let Some((_, object)) = &mut self.open else {
            return Err(self.fault("a triangle stands outside of any object"));
        };
        let count = object.positions.len();
        if let Some(&wrong) = [a, b, c].iter().find(|&&corner| corner as usize >= count) {
            return Err(ReadMeshError::NoSuchVertex {
                format: MeshFormat::ThreeMf,
                place: self.place,
                index: i64::from(wrong),
                vertices: count as u64,
            });
        }
        object.triangles.push([a, b, c]);
        Ok(())
    }

    fn a_use(&self, tag: &BytesStart<'_>) -> Result<Use, ReadMeshError> {
        let (mut object, mut path) = (None, None);
        let mut placed = Some(DAffine3::IDENTITY);
        self.attributes(tag, |key, value| match key {
            "objectid" => object = index(value),
            "path" => path = Some(value.to_owned()),
            "transform" => placed = transform(value),
            _ => {}
        })?;
        let object = object.ok_or_else(|| self.fault("a use of an object lacks its number"))?;
        let parent_from_object =
            placed.ok_or_else(|| self.fault("a transform does not have twelve numbers"))?;
        Ok(Use {
            path,
            object,
            parent_from_object,
        })
    }
}

fn index(value: &str) -> Option<u32> {
    integer(value.trim_ascii().as_bytes()).and_then(|index| index.try_into().ok())
}

/// The transform of row vectors, spelled row by row: the images of the axes and of the origin.
fn transform(value: &str) -> Option<DAffine3> {
    let mut numbers = [0.0; 12];
    let mut words = value.split_ascii_whitespace();
    for x in &mut numbers {
        *x = number(words.next()?.as_bytes()).filter(|x| x.is_finite())?;
    }
    words
        .next()
        .is_none()
        .then(|| DAffine3::from_cols_array(&numbers))
}
