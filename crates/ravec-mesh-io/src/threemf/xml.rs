//! The model parts of a 3MF file.

use std::io::BufReader;

use glam::{DAffine3, DVec3};
use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use ravec_memory::{MemoryBudget, Reservation};

use super::package::Part;
use super::parts::Parts;
use super::settings::Role;
use crate::error::{Place, ReadMeshError};
use crate::number::{integer, number, shown};
use crate::read::{MeshLimits, ReadWarning};
use crate::{LengthUnit, MeshFormat};
use ravec_memory::ReservedVec;

/// Bounds on the depth of elements and on the length of their names: the names of those that are open are held.
pub(super) const MAX_DEPTH: usize = 256;
pub(super) const MAX_NAME: usize = 1024;

/// Length to which names of objects are cut.
const MAX_TEXT: usize = 256;

/// A use of an object.
pub(super) struct Use {
    /// The number of the part it is in.
    pub(super) part: u32,
    pub(super) object: u32,
    pub(super) parent_from_object: DAffine3,
    /// Purpose that the settings of a slicer give it, whatever the type of the object.
    pub(super) role: Option<Role>,
}

/// The type of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Model,
    /// Not printed; as messages name it, in the singular.
    Auxiliary(&'static str),
}

impl Kind {
    fn of(word: &str) -> Self {
        match word {
            "model" | "" => Self::Model,
            "support" | "solidsupport" => Self::Auxiliary("support object"),
            "surface" => Self::Auxiliary("surface object"),
            _ => Self::Auxiliary("auxiliary object"),
        }
    }
}

/// A mesh or a collection of uses, or both.
pub(super) struct Object {
    pub(super) id: u32,
    pub(super) kind: Kind,
    pub(super) name: String,
    pub(super) positions: ReservedVec<DVec3>,
    pub(super) triangles: ReservedVec<[u32; 3]>,
    pub(super) components: ReservedVec<Use>,
}

/// One part.
pub(super) struct Model {
    pub(super) unit: LengthUnit,
    /// In the order of the file; ids may be repeated.
    pub(super) objects: ReservedVec<Object>,
    /// Items of the build.
    pub(super) items: ReservedVec<Use>,
    /// Memory of the names of objects.
    names: Reservation,
    pub(super) warnings: Vec<ReadWarning>,
}

/// Room for vertices and triangles of all objects of all parts.
pub(super) struct Room {
    limits: MeshLimits,
    vertices: u64,
    triangles: u64,
}

impl Room {
    pub(super) fn new(limits: &MeshLimits) -> Self {
        Self {
            limits: limits.clone(),
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

/// The reader of a part, and the element at hand.
pub(super) struct Elements<'a> {
    reader: Reader<BufReader<Part<'a>>>,
    buffer: Vec<u8>,
}

impl<'a> Elements<'a> {
    pub(super) fn of(part: BufReader<Part<'a>>) -> Self {
        Self {
            reader: Reader::from_reader(part),
            buffer: Vec::new(),
        }
    }

    /// The next one. A failure of the part is kept there.
    pub(super) fn next(&mut self) -> Result<Event<'_>, quick_xml::Error> {
        self.buffer.clear();
        self.reader.get_mut().get_mut().begin();
        self.reader.read_event_into(&mut self.buffer)
    }

    pub(super) fn take_failure(&mut self) -> Option<ReadMeshError> {
        self.reader.get_mut().get_mut().failure.take()
    }
}

/// The target of the relation of the root to the model; nothing if none can be found.
pub(super) fn root_of(relations: BufReader<Part<'_>>) -> Result<Option<String>, ReadMeshError> {
    const LONGEST: usize = 4096;
    let mut elements = Elements::of(relations);
    let mut depth = 0_usize;
    loop {
        match elements.next() {
            Ok(event @ (Event::Start(_) | Event::Empty(_))) => {
                depth += usize::from(matches!(event, Event::Start(_)));
                let (Event::Start(tag) | Event::Empty(tag)) = event else {
                    continue;
                };
                if depth > MAX_DEPTH || tag.name().as_ref().len() > MAX_NAME {
                    return Ok(None);
                }
                let (mut target, mut is_model) = (None, false);
                for attribute in tag.attributes().with_checks(false).flatten() {
                    match attribute.key.local_name().as_ref() {
                        "Target" if attribute.value.len() <= LONGEST => {
                            target = attribute.normalized_value(XmlVersion::Implicit1_0).ok();
                        }
                        "Type" => is_model = attribute.value.ends_with("/3dmodel"),
                        _ => {}
                    }
                }
                if is_model && let Some(target) = target {
                    return Ok(Some(target.into_owned()));
                }
            }
            Ok(Event::End(_)) => depth = depth.saturating_sub(1),
            Ok(Event::Eof) => return Ok(None),
            Ok(_) => {}
            Err(_) => {
                return match elements.take_failure() {
                    Some(failure @ (ReadMeshError::Cancelled | ReadMeshError::OverBudget(_))) => {
                        Err(failure)
                    }
                    _ => Ok(None),
                };
            }
        }
    }
}

/// Reads the part `number`.
pub(super) fn read_part(
    part: BufReader<Part<'_>>,
    number: usize,
    parts: &mut Parts,
    room: &mut Room,
) -> Result<Model, ReadMeshError> {
    let budget = room.limits.memory.clone();
    let mut elements = Elements::of(part);
    let mut builder = Builder {
        number,
        model: Model {
            unit: LengthUnit::Millimeter,
            objects: ReservedVec::new(&budget),
            items: ReservedVec::new(&budget),
            names: budget.reserve_nothing(),
            warnings: Vec::new(),
        },
        open: None,
        parts,
        room,
        budget,
        place: Place::Byte(0),
    };
    let mut depth = 0;
    loop {
        let start = elements.reader.buffer_position();
        builder.place = Place::Byte(start);
        let event = match elements.next() {
            Ok(event) => event,
            Err(error) => {
                let what = error.to_string();
                if let Some(failure) = elements.take_failure() {
                    return Err(failure);
                }
                builder.place = Place::Byte(elements.reader.error_position());
                return Err(builder.fault(shown(what.as_bytes())));
            }
        };
        match event {
            Event::Start(tag) => {
                depth += 1;
                if depth > MAX_DEPTH || tag.name().as_ref().len() > MAX_NAME {
                    let what = "elements are nested too deeply, or have names that are too long";
                    return Err(builder.fault(what));
                }
                builder.start(&tag)?;
            }
            Event::Empty(tag) => {
                builder.start(&tag)?;
                builder.end(tag.local_name().as_ref())?;
            }
            Event::End(tag) => {
                depth = depth.saturating_sub(1);
                builder.end(tag.local_name().as_ref())?;
            }
            Event::Eof if depth > 0 => {
                return Err(ReadMeshError::Truncated {
                    format: MeshFormat::ThreeMf,
                    place: Place::Byte(start),
                    inside: format!("the part {}", builder.name()),
                });
            }
            Event::Eof => break,
            _ => {}
        }
    }
    Ok(builder.model)
}

struct Builder<'a> {
    /// The number of the part.
    number: usize,
    model: Model,
    /// The object that has begun.
    open: Option<Object>,
    parts: &'a mut Parts,
    room: &'a mut Room,
    budget: MemoryBudget,
    /// Place at which the last tag begins.
    place: Place,
}

impl Builder<'_> {
    fn name(&self) -> String {
        shown(self.parts.path(self.number).unwrap_or_default().as_bytes())
    }

    fn fault(&self, what: impl std::fmt::Display) -> ReadMeshError {
        let what = format!("in the part {}: {what}", self.name());
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
                let (mut id, mut kind, mut name) = (None, Kind::Model, String::new());
                self.attributes(tag, |key, value| match key {
                    "id" => id = index(value),
                    "type" => kind = Kind::of(value),
                    "name" => name = text(value),
                    _ => {}
                })?;
                self.model.names.grow(name.len() as u64)?;
                let id = id.ok_or_else(|| self.fault("an object has no number for its id"))?;
                self.open = Some(Object {
                    id,
                    kind,
                    name,
                    positions: ReservedVec::new(&self.budget),
                    triangles: ReservedVec::new(&self.budget),
                    components: ReservedVec::new(&self.budget),
                });
                Ok(())
            }
            "component" => {
                let component = self.a_use(tag)?;
                match &mut self.open {
                    Some(object) => object.components.push(component)?,
                    None => return Err(self.fault("a component stands outside of any object")),
                }
                Ok(())
            }
            "item" => {
                let item = self.a_use(tag)?;
                self.model.items.push(item)?;
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

    fn end(&mut self, name: &str) -> Result<(), ReadMeshError> {
        if name == "object"
            && let Some(object) = self.open.take()
        {
            self.model.objects.push(object)?;
        }
        Ok(())
    }

    /// Calls `each` with the names, less the prefix, and the values of a tag's attributes.
    fn attributes(
        &self,
        tag: &BytesStart<'_>,
        mut each: impl FnMut(&str, &str),
    ) -> Result<(), ReadMeshError> {
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| {
                let what = error.to_string();
                self.fault(shown(what.as_bytes()))
            })?;
            each(attribute.key.local_name().as_ref(), &attribute.value);
        }
        Ok(())
    }

    fn model(&mut self, tag: &BytesStart<'_>) -> Result<(), ReadMeshError> {
        const LONGEST: usize = 1024;
        let mut wrong_unit = None;
        let (mut unit, mut required, mut too_long) = (None, String::new(), false);
        self.attributes(tag, |key, value| match key {
            "unit" => {
                unit = LengthUnit::ALL
                    .into_iter()
                    .find(|known| known.name() == value);
                wrong_unit = unit.is_none().then(|| shown(value.as_bytes()));
            }
            "requiredextensions" => {
                too_long = value.len() > LONGEST;
                required.clear();
                required.push_str(if too_long { "" } else { value });
            }
            _ => {}
        })?;
        if let Some(unit) = wrong_unit {
            return Err(self.fault(format!("`{unit}` is not a unit of length")));
        }
        self.model.unit = unit.unwrap_or(self.model.unit);
        if too_long {
            return Err(self.fault("it requires more extensions than are read"));
        }
        // the prefixes, whether what they stand for is read or named where it is left out, and its name
        let words = required.split_ascii_whitespace();
        let mut prefixes: Vec<(&str, bool, String)> =
            words.map(|prefix| (prefix, false, String::new())).collect();
        prefixes.sort_unstable();
        prefixes.dedup();
        self.attributes(tag, |key, value| {
            if let Ok(at) = prefixes.binary_search_by_key(&key, |(prefix, ..)| prefix) {
                prefixes[at].1 = KNOWN.iter().any(|known| value.contains(known));
                prefixes[at].2 = shown(value.as_bytes());
            }
        })?;
        match prefixes.iter().find(|(_, known, _)| !known) {
            Some((prefix, _, name)) => Err(unread(&required_by_name(prefix, name))),
            None => Ok(()),
        }
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
        if let Some(object) = &mut self.open {
            object.positions.push(at)?;
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
        let Some(object) = &mut self.open else {
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
        object.triangles.push([a, b, c])?;
        Ok(())
    }

    fn a_use(&mut self, tag: &BytesStart<'_>) -> Result<Use, ReadMeshError> {
        let (mut object, mut path) = (None, None);
        let mut placed = Some(DAffine3::IDENTITY);
        let mut printable = true;
        self.attributes(tag, |key, value| match key {
            "objectid" => object = index(value),
            "path" => path = Some(value.to_owned()),
            "transform" => placed = transform(value),
            "printable" => printable = !matches!(value, "0" | "false"),
            _ => {}
        })?;
        let object = object.ok_or_else(|| self.fault("a use of an object lacks its number"))?;
        let parent_from_object =
            placed.ok_or_else(|| self.fault("a transform does not have twelve numbers"))?;
        let part = match path {
            Some(path) => self.parts.number(&path)?,
            None => self.number as u32,
        };
        Ok(Use {
            part,
            object,
            parent_from_object,
            role: (!printable).then_some(Role::Auxiliary("unprintable item")),
        })
    }
}

/// Text with its entities replaced, cut to a length that names have.
pub(super) fn text(value: &str) -> String {
    let end = value.floor_char_boundary(MAX_TEXT);
    let value = &value[..end];
    quick_xml::escape::unescape(value).map_or_else(|_| value.to_owned(), Into::into)
}

/// Parts of the names of extensions that a file may require: they leave the shape as it is, or what is left out is named.
const KNOWN: [&str; 5] = [
    "/material/",
    "/production/",
    "/trianglesets/",
    "/beamlattice/",
    "/slice/",
];

/// An extension as it is shown: by its name if the file gives it, else by its prefix.
fn required_by_name(prefix: &str, name: &str) -> String {
    if name.is_empty() {
        shown(prefix.as_bytes())
    } else {
        format!("`{name}`")
    }
}

fn unread(extension: &str) -> ReadMeshError {
    ReadMeshError::Unsupported {
        format: MeshFormat::ThreeMf,
        what: format!(
            "the file needs the extension {extension}, which is not read here; save it without extensions"
        ),
    }
}

pub(super) fn index(value: &str) -> Option<u32> {
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
