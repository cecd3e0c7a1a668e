//! The archive that a 3MF file is.

use std::io::{self, BufReader, Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

use super::super::MeshFormat;
use super::super::error::{Place, ReadMeshError};
use super::super::source::Source;

/// Where the model is if nothing says otherwise.
const USUAL: &str = "3D/3dmodel.model";

pub(super) struct Package {
    archive: ZipArchive<Cursor<Vec<u8>>>,
    limit: u64,
    /// How many bytes may still be unpacked.
    left: u64,
}

/// One unpacked file, which fails when it grows beyond what is allowed.
pub(super) struct Part<'a> {
    reader: Box<dyn Read + 'a>,
    left: &'a mut u64,
    /// Whether it failed for that reason.
    pub(super) too_large: bool,
}

impl Read for Part<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.reader.read(buffer)?;
        if got as u64 > *self.left {
            self.too_large = true;
            return Err(io::Error::other("too large"));
        }
        *self.left -= got as u64;
        Ok(got)
    }
}

fn fault(error: &ZipError) -> ReadMeshError {
    let what = match error {
        ZipError::UnsupportedArchive(what) => format!("the archive cannot be unpacked: {what}"),
        other => format!("the archive is damaged: {other}; get it again from where it came"),
    };
    ReadMeshError::Unsupported {
        format: MeshFormat::ThreeMf,
        what,
    }
}

impl Package {
    pub(super) fn open(source: Source<'_>) -> Result<Self, ReadMeshError> {
        let limit = source.limits.max_bytes;
        let file = source.rest()?;
        let left = limit - file.len() as u64;
        let archive = ZipArchive::new(Cursor::new(file)).map_err(|error| fault(&error))?;
        Ok(Self {
            archive,
            limit,
            left,
        })
    }

    /// That the limit of bytes is broken.
    pub(super) fn too_large(&self) -> ReadMeshError {
        ReadMeshError::TooMany {
            what: "bytes",
            limit: self.limit,
        }
    }

    /// The file called `name`, in any case and with or without a slash in front; nothing if there is none.
    pub(super) fn part(
        &mut self,
        name: &str,
    ) -> Result<Option<BufReader<Part<'_>>>, ReadMeshError> {
        let name = name.trim_start_matches('/');
        let names = self.archive.file_names_raw();
        let same = |other: &[u8]| other.eq_ignore_ascii_case(name.as_bytes());
        let Some(index) = names.into_iter().position(same) else {
            return Ok(None);
        };
        let file = self
            .archive
            .by_index(index)
            .map_err(|error| fault(&error))?;
        let part = Part {
            reader: Box::new(file),
            left: &mut self.left,
            too_large: false,
        };
        Ok(Some(BufReader::with_capacity(1 << 16, part)))
    }

    /// The name of the part that holds the model.
    pub(super) fn root(&mut self) -> Result<String, ReadMeshError> {
        if let Some(relations) = self.part("_rels/.rels")? {
            let target = super::xml::root_of(relations);
            if let Some(target) = target {
                return Ok(target);
            }
        }
        let mut names = self.archive.file_names_raw();
        if names.any(|name| name.eq_ignore_ascii_case(USUAL.as_bytes())) {
            return Ok(USUAL.to_owned());
        }
        Err(ReadMeshError::syntax(
            MeshFormat::ThreeMf,
            Place::Byte(0),
            "this archive does not hold a 3D model; if there is a mesh file inside, unpack it first",
        ))
    }
}
