//! Meshes made ready: closed, examined, and turned where they are inside out.

use std::borrow::Cow;

use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};

use super::Checked;
use crate::arrangement::Soup;
use crate::closing::{Closing, close};
use crate::examine::{Examined, examine};
use crate::params::{BooleanError, BooleanParams, BooleanReport};

/// Meshes as they are combined.
pub(super) struct Inputs<'a> {
    /// Parts that are inside out are turned.
    pub meshes: Vec<Cow<'a, TriMesh>>,
    /// For each triangle of each mesh whether it was turned; empty if none was.
    pub turned: Vec<Vec<bool>>,
    pub closings: Vec<Closing>,
    /// `true` for meshes of which all triangles have an area.
    sound: Vec<bool>,
}

impl Inputs<'_> {
    pub fn soup(&self, progress: &Progress) -> Result<Soup, Cancelled> {
        let list: Vec<&TriMesh> = self.meshes.iter().map(AsRef::as_ref).collect();
        Soup::of(&list, &self.closings, &self.sound, progress)
    }

    /// Leaves only meshes that have an effect on the result.
    pub fn keep(&mut self, expr: &Checked, report: &mut BooleanReport) {
        let needed = expr.pruned.meshes();
        let is_needed = |mesh: &usize| needed.binary_search(mesh).is_ok();
        let pruned = expr.named.iter().filter(|mesh| !is_needed(mesh));
        report.pruned = pruned.map(|&mesh| mesh as u32).collect();
        for (index, mesh) in self.meshes.iter_mut().enumerate() {
            if !is_needed(&index) {
                *mesh = Cow::Owned(TriMesh::default());
            }
        }
    }
}

/// Closes and examines meshes, and turns what is inside out.
pub(super) fn prepare<'a>(
    meshes: &'a [TriMesh],
    params: &BooleanParams,
    report: &mut BooleanReport,
    progress: &Progress,
) -> Result<Inputs<'a>, BooleanError> {
    let mut inputs = Inputs {
        meshes: Vec::with_capacity(meshes.len()),
        turned: Vec::with_capacity(meshes.len()),
        closings: Vec::with_capacity(meshes.len()),
        sound: Vec::with_capacity(meshes.len()),
    };
    for (index, mesh) in meshes.iter().enumerate() {
        let mut closing = close(mesh, params.close, progress)?;
        if closing.is_no_relief {
            return Err(BooleanError::NotARelief { mesh: index });
        }
        let Examined {
            report: operand,
            turn: mut turned,
        } = examine(mesh, &closing, params.inside, progress)?;
        let mut own = Cow::Borrowed(mesh);
        if !turned.is_empty() {
            let of_closing = turned.split_off(mesh.triangles().len());
            let mut triangles = mesh.triangles().to_vec();
            let own_turned = triangles.iter_mut().zip(&turned);
            for (t, _) in own_turned
                .chain(closing.triangles.iter_mut().zip(&of_closing))
                .filter(|(_, turned)| **turned)
            {
                t.swap(1, 2);
            }
            let mesh = TriMesh::new(mesh.positions().to_vec(), triangles);
            own = Cow::Owned(mesh.expect("vertices are those of a mesh"));
        }
        inputs.meshes.push(own);
        inputs.turned.push(turned);
        inputs.closings.push(closing);
        inputs.sound.push(operand.degenerate_triangles == 0);
        report.operands.push(operand);
    }
    Ok(inputs)
}
