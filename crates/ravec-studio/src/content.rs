//! Pictures and meshes as values that edits pass on.

use crate::shown::Shown;
use crate::view::mesh::ShownMesh;
use ravec::mesh_io::{MeshFile, MeshFormat};
use ravec::raster::with_image;
use ravec_media::Picture;
use std::path::Path;
use std::sync::Arc;

/// Kind of a document, by the name of its source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A still picture.
    Picture,
    /// A triangle mesh.
    Mesh,
    /// A clip: a file of video, a folder or a pattern of pictures.
    Clip,
}

impl Kind {
    /// The kind of the file at `path`. Animations and folders are clips; names of no kind are pictures, whose reader says what is
    /// wrong with them.
    pub fn of(path: &Path) -> Self {
        let extension = path.extension().and_then(|extension| extension.to_str());
        if extension.is_some_and(|extension| MeshFormat::from_extension(extension).is_some()) {
            Self::Mesh
        } else if ravec_video::is_clip_name(path) || path.is_dir() {
            Self::Clip
        } else {
            Self::Picture
        }
    }

    /// Name of the extension of results.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Picture => "png",
            Self::Mesh => "ply",
            Self::Clip => "mp4",
        }
    }
}

/// Input or output of an edit. Clones share the data.
#[derive(Debug, Clone)]
pub enum Content {
    /// A picture, or a frame of a clip.
    Picture(Arc<Picture>),
    /// A mesh.
    Mesh(Arc<MeshFile>),
}

impl Content {
    /// The picture.
    pub fn picture(&self) -> Option<&Arc<Picture>> {
        match self {
            Self::Picture(picture) => Some(picture),
            Self::Mesh(_) => None,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> Option<&Arc<MeshFile>> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Picture(_) => None,
        }
    }

    /// Columns and rows of a picture; zeros for a mesh.
    pub fn size(&self) -> [usize; 2] {
        self.picture().map_or([0, 0], |picture| {
            let size = picture.image.size();
            [size.width(), size.height()]
        })
    }

    /// Bytes in memory, without small change.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Picture(picture) => {
                with_image!(&picture.image, image => std::mem::size_of_val(image.pixels()))
            }
            Self::Mesh(file) => 24 * file.mesh.positions().len() + 12 * file.mesh.triangles().len(),
        }
    }
}

/// A content as a canvas takes it.
#[derive(Debug, Clone)]
pub enum View {
    /// A picture.
    Picture(Arc<Shown>),
    /// A mesh.
    Mesh(Arc<ShownMesh>),
}

impl View {
    /// The view of a content, brighter by a number of stops. The work is done in the caller's thread.
    pub fn new(content: &Content, exposure: f32) -> Self {
        match content {
            Content::Picture(picture) => {
                Self::Picture(Arc::new(Shown::exposed(picture.clone(), exposure)))
            }
            Content::Mesh(file) => {
                Self::Mesh(Arc::new(ShownMesh::new(Arc::new(file.mesh.clone()))))
            }
        }
    }

    /// The picture.
    pub fn picture(&self) -> Option<&Arc<Shown>> {
        match self {
            Self::Picture(shown) => Some(shown),
            Self::Mesh(_) => None,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> Option<&Arc<ShownMesh>> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Picture(_) => None,
        }
    }
}

/// A content with its view.
#[derive(Debug, Clone)]
pub struct Visible {
    /// The content.
    pub content: Content,
    /// Its view.
    pub view: View,
}
