//! Subjects of `scenes`: scenes and clips by name.

use ravec::raster::Size;
use ravec_scenes::catalog::SceneId;
use ravec_scenes::clip::ClipId;
use serde::{Deserialize, Serialize};

/// A scene or a clip of the catalogues; written as its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Subject {
    /// A picture.
    Scene(SceneId),
    /// A sequence of frames.
    Clip(ClipId),
}

/// No scene and no clip has the name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no scene or clip '{0}': `ravec help scenes` lists them")]
pub struct UnknownScene(pub String);

impl Subject {
    /// All scenes, then all clips.
    pub fn all() -> impl Iterator<Item = Self> {
        let scenes = SceneId::ALL.into_iter().map(Self::Scene);
        scenes.chain(ClipId::ALL.into_iter().map(Self::Clip))
    }

    /// The name that selects it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene(id) => id.name(),
            Self::Clip(id) => id.name(),
        }
    }

    /// One line about it.
    pub fn description(self) -> &'static str {
        match self {
            Self::Scene(id) => id.description(),
            Self::Clip(id) => id.description(),
        }
    }

    /// The size at which it shows what it is for.
    pub fn default_size(self) -> Size {
        match self {
            Self::Scene(id) => id.default_size(),
            Self::Clip(id) => id.default_size(),
        }
    }
}

impl From<SceneId> for Subject {
    fn from(id: SceneId) -> Self {
        Self::Scene(id)
    }
}

impl From<ClipId> for Subject {
    fn from(id: ClipId) -> Self {
        Self::Clip(id)
    }
}

impl TryFrom<String> for Subject {
    type Error = UnknownScene;

    fn try_from(name: String) -> Result<Self, UnknownScene> {
        let found = Self::all().find(|subject| subject.name() == name);
        found.ok_or(UnknownScene(name))
    }
}

impl From<Subject> for String {
    fn from(subject: Subject) -> Self {
        subject.name().to_owned()
    }
}
