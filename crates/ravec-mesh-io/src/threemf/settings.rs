//! The settings that slicers keep beside the model: which volumes of an object are printed, and as what.
//!
//! `PrusaSlicer` and its relatives name volumes by ranges of triangles of an object, `OrcaSlicer` and Bambu Studio by the
//! components of an object. Negative volumes become components of their own, marked as such; modifiers and the like are left
//! out.

use std::io::BufReader;

use glam::{DAffine3, DVec3};
use quick_xml::events::{BytesStart, Event};
use ravec_memory::{MemoryBudget, Reservation, ReservedVec};
use ravec_progress::Progress;

use super::left_out::LeftOut;
use super::package::Part;
use super::xml::{Elements, Kind, MAX_DEPTH, MAX_NAME, Model, Object, Use, index, text};
use crate::error::{Place, ReadMeshError};

/// The parts that settings are in.
pub(super) const PATHS: [&str; 4] = [
    "Metadata/Slic3r_PE_model.config",
    "Metadata/model_settings.config",
    "Metadata/SuperSlicer_model.config",
    "Metadata/Slic3r_model.config",
];

/// Number of triangles or components that are looked at between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

/// Purpose of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// Printed.
    Part,
    /// Subtracted from the other volumes of its object.
    Negative,
    /// Left out; as messages name it, in the singular.
    Auxiliary(&'static str),
}

impl Role {
    fn of(word: &str) -> Self {
        match word {
            "ModelPart" | "normal_part" => Self::Part,
            "NegativeVolume" | "negative_part" => Self::Negative,
            "ParameterModifier" | "modifier_part" => Self::Auxiliary("modifier"),
            "SupportEnforcer" | "support_enforcer" => Self::Auxiliary("support enforcer"),
            "SupportBlocker" | "support_blocker" => Self::Auxiliary("support blocker"),
            _ => Self::Auxiliary("unknown volume"),
        }
    }
}

/// The volume of an object, in the order in which they are looked up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Which {
    /// Its own triangles, from the first to the last.
    Triangles(u32, u32),
    /// The component with this number.
    Component(u32),
}

struct Volume {
    object: u32,
    which: Which,
    role: Role,
    name: String,
}

/// The settings of all objects.
pub(super) struct Settings {
    volumes: ReservedVec<Volume>,
    names: ReservedVec<(u32, String)>,
    /// Memory of the names.
    memory: Reservation,
}

/// The element that metadata belong to.
#[derive(Clone, Copy, PartialEq)]
enum Of {
    Nothing,
    Object(u32),
    Volume(u32),
}

impl Settings {
    pub(super) fn new(budget: &MemoryBudget) -> Self {
        Self {
            volumes: ReservedVec::new(budget),
            names: ReservedVec::new(budget),
            memory: budget.reserve_nothing(),
        }
    }

    /// Adds the settings in `part`. Says whether they could be read.
    pub(super) fn read(&mut self, part: BufReader<Part<'_>>) -> Result<bool, ReadMeshError> {
        let mut elements = Elements::of(part);
        let (mut depth, mut of) = (0, Of::Nothing);
        loop {
            match elements.next() {
                Ok(Event::Start(tag)) => {
                    depth += 1;
                    if depth > MAX_DEPTH || tag.name().as_ref().len() > MAX_NAME {
                        return Ok(false);
                    }
                    self.start(&tag, &mut of)?;
                }
                Ok(Event::Empty(tag)) => {
                    let before = of;
                    self.start(&tag, &mut of)?;
                    of = before;
                }
                Ok(Event::End(tag)) => {
                    depth = depth.saturating_sub(1);
                    of = match (tag.local_name().as_ref(), of) {
                        ("volume" | "part", Of::Volume(object)) => Of::Object(object),
                        ("object", _) => Of::Nothing,
                        _ => of,
                    };
                }
                Ok(Event::Eof) => return Ok(depth == 0),
                Ok(_) => {}
                Err(_) => {
                    return match elements.take_failure() {
                        Some(
                            failure @ (ReadMeshError::Cancelled | ReadMeshError::OverBudget(_)),
                        ) => Err(failure),
                        _ => Ok(false),
                    };
                }
            }
        }
    }

    fn start(&mut self, tag: &BytesStart<'_>, of: &mut Of) -> Result<(), ReadMeshError> {
        let (mut id, mut first, mut last, mut role) = (None, None, None, Role::Part);
        let (mut key, mut value) = (String::new(), String::new());
        for attribute in tag.attributes().with_checks(false).flatten() {
            let written: &str = &attribute.value;
            match attribute.key.local_name().as_ref() {
                "id" => id = index(written),
                "firstid" => first = index(written),
                "lastid" => last = index(written),
                "subtype" => role = Role::of(written),
                "key" => key = text(written),
                "value" => value = text(written),
                _ => {}
            }
        }
        match (tag.local_name().as_ref(), *of) {
            ("object", _) => *of = id.map_or(Of::Nothing, Of::Object),
            ("volume", Of::Object(object) | Of::Volume(object)) => {
                if let (Some(first), Some(last)) = (first, last) {
                    self.volume(object, Which::Triangles(first, last), role)?;
                    *of = Of::Volume(object);
                }
            }
            ("part", Of::Object(object) | Of::Volume(object)) => {
                if let Some(id) = id {
                    self.volume(object, Which::Component(id), role)?;
                    *of = Of::Volume(object);
                }
            }
            ("metadata", Of::Object(object)) if key == "name" => {
                self.memory.grow(value.len() as u64)?;
                self.names.push((object, value))?;
            }
            ("metadata", Of::Volume(_)) => {
                let Some(volume) = self.volumes.last_mut() else {
                    return Ok(());
                };
                match key.as_str() {
                    "name" => {
                        self.memory.grow(value.len() as u64)?;
                        volume.name = value;
                    }
                    "volume_type" => volume.role = Role::of(&value),
                    "modifier" if value == "1" && volume.role == Role::Part => {
                        volume.role = Role::of("ParameterModifier");
                    }
                    _ => {}
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn volume(&mut self, object: u32, which: Which, role: Role) -> Result<(), ReadMeshError> {
        self.volumes.push(Volume {
            object,
            which,
            role,
            name: String::new(),
        })?;
        Ok(())
    }

    /// Names the objects of the root part, makes components of their negative volumes, and takes out what is not printed.
    pub(super) fn apply(
        mut self,
        model: &mut Model,
        left_out: &mut LeftOut,
        budget: &MemoryBudget,
        progress: &Progress,
    ) -> Result<(), ReadMeshError> {
        self.volumes
            .sort_unstable_by_key(|volume| (volume.object, volume.which));
        self.names.sort_by_key(|(object, _)| *object);
        let mut free = model.objects.iter().map(|object| object.id).max();
        let mut extracted: ReservedVec<Object> = ReservedVec::new(budget);
        for object in model.objects.iter_mut() {
            progress.check()?;
            if let Ok(at) = self.names.binary_search_by_key(&object.id, |(id, _)| *id) {
                object.name.clone_from(&self.names[at].1);
            }
            let begin = self
                .volumes
                .partition_point(|volume| volume.object < object.id);
            let end = self
                .volumes
                .partition_point(|volume| volume.object <= object.id);
            let volumes = &self.volumes[begin..end];
            if volumes.is_empty() {
                continue;
            }
            assign(object, volumes, left_out, progress)?;
            let Some(negative) = split(object, volumes, left_out, budget, progress)? else {
                continue;
            };
            free = free.and_then(|id| id.checked_add(1));
            let Some(id) = free else {
                let what = "its id leaves no higher one for its negative volumes; number the objects from 1";
                let place = Place::Item {
                    of: "object",
                    index: u64::from(object.id),
                };
                return Err(ReadMeshError::syntax(
                    crate::MeshFormat::ThreeMf,
                    place,
                    what,
                ));
            };
            object.components.push(Use {
                part: 0,
                object: id,
                parent_from_object: DAffine3::IDENTITY,
                role: Some(Role::Negative),
            })?;
            extracted.push(Object { id, ..negative })?;
        }
        let (extracted, _memory) = extracted.into_parts();
        for object in extracted {
            model.objects.push(object)?;
        }
        Ok(())
    }
}

/// Gives the components of an object their roles, and takes out those that are not printed.
fn assign(
    object: &mut Object,
    volumes: &[Volume],
    left_out: &mut LeftOut,
    progress: &Progress,
) -> Result<(), ReadMeshError> {
    for (i, component) in object.components.iter_mut().enumerate() {
        if i % AT_ONCE == 0 {
            progress.check()?;
        }
        let wanted = Which::Component(component.object);
        let Ok(at) = volumes.binary_search_by_key(&wanted, |volume| volume.which) else {
            continue;
        };
        let volume = &volumes[at];
        component.role = Some(volume.role);
        match volume.role {
            Role::Part => {}
            Role::Negative => left_out.add_negative(&volume.name),
            Role::Auxiliary(what) => left_out.add(what, &volume.name),
        }
    }
    object
        .components
        .retain(|component| !matches!(component.role, Some(Role::Auxiliary(_))));
    Ok(())
}

/// Takes the triangles that are not printed out of an object; those of negative volumes become an object, if there are any.
fn split(
    object: &mut Object,
    volumes: &[Volume],
    left_out: &mut LeftOut,
    budget: &MemoryBudget,
    progress: &Progress,
) -> Result<Option<Object>, ReadMeshError> {
    let count = volumes.partition_point(|v| matches!(v.which, Which::Triangles(..)));
    let volumes = &volumes[..count];
    if volumes.iter().all(|volume| volume.role == Role::Part) {
        return Ok(None);
    }
    let triangles = object.triangles.len() as u64;
    for volume in volumes {
        match (volume.which, volume.role) {
            (Which::Triangles(first, last), _) if first > last || u64::from(first) >= triangles => {
            }
            (_, Role::Part) => {}
            (_, Role::Negative) => left_out.add_negative(&volume.name),
            (_, Role::Auxiliary(what)) => left_out.add(what, &volume.name),
        }
    }
    let role_of = |triangle: u32| {
        let end = volumes.partition_point(|volume| match volume.which {
            Which::Triangles(first, _) => first <= triangle,
            Which::Component(_) => false,
        });
        let volume = volumes[..end].last().filter(|volume| match volume.which {
            Which::Triangles(_, last) => triangle <= last,
            Which::Component(_) => false,
        });
        volume.map_or(Role::Part, |volume| volume.role)
    };
    let mut kept = ReservedVec::new(budget);
    let mut negative = ReservedVec::new(budget);
    for (i, &triangle) in (0_u32..).zip(object.triangles.iter()) {
        if (i as usize).is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        match role_of(i) {
            Role::Part => kept.push(triangle)?,
            Role::Negative => negative.push(triangle)?,
            Role::Auxiliary(_) => {}
        }
    }
    let part = compact(&object.positions, kept, budget)?;
    let negative = compact(&object.positions, negative, budget)?;
    (object.positions, object.triangles) = part;
    let (positions, triangles) = negative;
    Ok((!triangles.is_empty()).then_some(Object {
        id: 0,
        kind: Kind::Model,
        name: String::new(),
        positions,
        triangles,
        components: ReservedVec::new(budget),
    }))
}

/// A mesh of its own.
type Rows = (ReservedVec<DVec3>, ReservedVec<[u32; 3]>);

/// The triangles with the vertices that they use, in their order.
fn compact(
    positions: &[DVec3],
    mut triangles: ReservedVec<[u32; 3]>,
    budget: &MemoryBudget,
) -> Result<Rows, ReadMeshError> {
    const UNUSED: u32 = u32::MAX;
    let mut places: ReservedVec<u32> = ReservedVec::new(budget);
    places.fill_up_to(positions.len(), UNUSED)?;
    for &corner in triangles.iter().flatten() {
        places[corner as usize] = 0;
    }
    let mut used = ReservedVec::new(budget);
    for (place, &at) in places.iter_mut().zip(positions) {
        if *place != UNUSED {
            *place = used.len() as u32;
            used.push(at)?;
        }
    }
    for corner in triangles.iter_mut().flatten() {
        *corner = places[*corner as usize];
    }
    Ok((used, triangles))
}
