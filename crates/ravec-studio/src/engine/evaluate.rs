//! The results of a document, one edit after the other.

use super::cache::{Cache, Cached, source_key};
use super::frames::FrameAt;
use super::shot::{OpenShots, ShotEdit};
use super::{EditInput, Failure, Request, lock};
use crate::content::{Content, Kind, View, Visible};
use crate::device::edit_context;
use crate::document::{Document, Edit, EditId, is_result_name, result_name};
use crate::painting::{Finished, Painting};
use ravec::mesh_io::{ReadOptions, read_mesh_file_with};
use ravec::progress::Progress;
use ravec_jobs::{Context, JobError, Report};
use ravec_media::Picture;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// The result of a request.
#[derive(Clone)]
pub(super) struct Evaluated {
    pub visible: Visible,
    pub key: Arc<str>,
    pub before: Option<View>,
    pub inputs: Arc<Inputs>,
    pub reports: Arc<Reports>,
    pub frame: Option<u64>,
}

/// The result of a request; no failure for a cancelled run. `on_run` takes each edit that is run, with its input.
pub(super) fn evaluate(
    request: &Request,
    progress: &Progress,
    cache: &mut Cache,
    shots: &mut OpenShots,
    painting: &Mutex<Painting>,
    mut on_run: impl FnMut(EditId, &EditInput),
) -> Result<Evaluated, Option<Failure>> {
    let Request {
        document,
        frame,
        exposure,
        analyses,
    } = request;
    let edits: Vec<&Arc<Edit>> = document.links().collect();
    let Chain { keys, prepared } = Chain::of(request, &edits);
    let known = (0..keys.len())
        .rev()
        .find_map(|k| Some((k, cache.get(&keys[k])?)));
    let (mut done, mut result) = if let Some(known) = known {
        known
    } else {
        let content = match frame {
            Some(frame) => Ok(Content::Picture(frame.picture.clone())),
            None => read(&document.source, progress),
        };
        let content = content.map_err(|message| {
            message.map(|message| Failure {
                edit: None,
                message,
            })
        })?;
        let result = Cached::new(content, None);
        cache.insert(&keys[0], result.clone());
        (0, result)
    };
    while done < edits.len() {
        let edit = edits[done];
        let failed = |message: String| {
            Some(Failure {
                edit: Some(edit.id),
                message,
            })
        };
        let input = EditInput {
            key: keys[done].as_str().into(),
            content: result.content.clone(),
        };
        on_run(edit.id, &input);
        let painted = match &prepared[done] {
            None => painted(edit, &input, painting, progress),
            Some(_) => None,
        };
        done += 1;
        if let Some((picture, view)) = painted {
            result = Cached::new(Content::Picture(picture), None);
            let view = view.map(View::Picture);
            cache.insert_painted(edit.id, &input.key, &keys[done], result.clone(), view);
            continue;
        }
        let result_of = match &prepared[done - 1] {
            Some((of, number)) => {
                let context = analyses.context(progress);
                let content = shots.result(of, &input.content, *number, &context);
                content.map(|content| (content, None))
            }
            None => run_in_memory(edit, &input.content, progress)
                .map(|(content, report)| (content, Some(report))),
        };
        let (content, report) = match result_of {
            Ok(done) => done,
            Err(RunError::Edit(reason)) => return Err(failed(reason)),
            Err(RunError::Job(JobError::Cancelled)) => return Err(None),
            Err(RunError::Job(error)) => return Err(failed(error.to_string())),
        };
        result = Cached::new(content, report.map(Arc::new));
        cache.insert(&keys[done], result.clone());
    }
    let (inputs, reports) = inputs_and_reports(document, &edits, &keys, cache);
    let key = &keys[edits.len()];
    let view = cache.view(key, &result.content, *exposure);
    let source = cache.get(&keys[0]);
    Ok(Evaluated {
        visible: Visible {
            content: result.content,
            view,
        },
        key: key.as_str().into(),
        before: source.map(|source| cache.view(&keys[0], &source.content, *exposure)),
        inputs: Arc::new(inputs),
        reports: Arc::new(reports),
        frame: frame.as_ref().map(|frame| frame.place.number),
    })
}

/// The results of a document, one for each edit, before they are computed.
struct Chain {
    /// The edits that each result is made by, from the source on.
    keys: Vec<String>,
    /// The edits of a shot, with the number of the frame in their input.
    prepared: Vec<Option<(ShotEdit, u64)>>,
}

impl Chain {
    fn of(request: &Request, edits: &[&Arc<Edit>]) -> Self {
        let Request {
            document,
            frame,
            analyses,
            ..
        } = request;
        let mut keys = vec![source_key(&document.source, frame.as_ref())];
        let mut prepared = Vec::new();
        let mut at = (frame.as_ref()).map(|frame| FrameAt::in_source(frame.place, document));
        for edit in edits {
            let fields = serde_json::to_string(&edit.fields).unwrap_or_default();
            let before = &keys[keys.len() - 1];
            let files = files_key(edit);
            let shot = at
                .as_mut()
                .and_then(|at| at.prepare(edit, document, analyses));
            let more = shot.as_ref().map_or("", |(shot, _)| shot.key());
            keys.push(format!(
                "{before}\n{} {fields}\n{files}\n{more}",
                edit.operation
            ));
            prepared.push(shot);
        }
        Self { keys, prepared }
    }
}

/// Inputs of edits by their numbers.
type Inputs = HashMap<EditId, EditInput>;

/// Reports of edits by their numbers.
type Reports = HashMap<EditId, Arc<Report>>;

/// The inputs and the reports of edits whose results are there.
fn inputs_and_reports(
    document: &Document,
    edits: &[&Arc<Edit>],
    keys: &[String],
    cache: &mut Cache,
) -> (Inputs, Reports) {
    let mut inputs = HashMap::new();
    let mut reports = HashMap::new();
    for (k, edit) in edits.iter().enumerate() {
        if let Some(input) = cache.get(&keys[k]) {
            let key = keys[k].as_str().into();
            let content = input.content;
            inputs.insert(edit.id, EditInput { key, content });
        }
        if let Some(report) = cache.get(&keys[k + 1]).and_then(|output| output.report) {
            reports.insert(edit.id, report);
        }
    }
    // edits that look at the picture without changing it
    for (index, edit) in document.edits.iter().enumerate() {
        if edit.is_analysis() {
            let before = document.edits[..index].iter();
            let links = before
                .filter(|edit| edit.enabled && !edit.is_analysis())
                .count();
            if let Some(input) = cache.get(&keys[links]) {
                let key = keys[links].as_str().into();
                let content = input.content;
                inputs.insert(edit.id, EditInput { key, content });
            }
        }
    }
    (inputs, reports)
}

/// Text that changes with the further files of an edit, such as masks.
pub(crate) fn files_key(edit: &Edit) -> String {
    let names = [result_name(0), result_name(1)];
    let Ok(step) = edit.step(&names[0], &names[1]) else {
        // the run says what is wrong
        return String::new();
    };
    let inputs = step.operation().inputs();
    let files = inputs.into_iter().filter(|path| !is_result_name(path));
    let keys: Vec<String> = files.map(|path| source_key(path, None)).collect();
    keys.join("\n")
}

/// Reads a picture or a mesh; no message if cancelled.
fn read(path: &Path, progress: &Progress) -> Result<Content, Option<String>> {
    let context = Context::new(progress);
    if Kind::of(path) == Kind::Mesh {
        let options = ReadOptions {
            limits: context.mesh_limits(),
            colors: true,
            texture: true,
            ..ReadOptions::default()
        };
        return match read_mesh_file_with(path, options, progress) {
            Ok((file, _)) => Ok(Content::Mesh(Arc::new(file))),
            Err(_) if progress.is_cancelled() => Err(None),
            Err(error) => Err(Some(error.to_string())),
        };
    }
    let picture = ravec_media::read(path, &context.limits);
    let picture = picture.map_err(|error| Some(error.to_string()))?;
    Ok(Content::Picture(Arc::new(picture)))
}

pub(crate) enum RunError {
    Edit(String),
    Job(JobError),
}

/// The result of a brush that goes on from the picture in the hand.
fn painted(
    edit: &Edit,
    input: &EditInput,
    painting: &Mutex<Painting>,
    progress: &Progress,
) -> Option<Finished> {
    let picture = input.content.picture()?;
    let mut painting = lock(painting);
    // strokes that make no sense get their message from the operation
    let followed = painting.follow(&input.key, edit, picture, progress);
    followed.ok().flatten()?;
    painting.finished(&input.key, edit, picture)
}

/// Runs one edit on a content.
pub(crate) fn run_in_memory(
    edit: &Edit,
    input: &Content,
    progress: &Progress,
) -> Result<(Content, Report), RunError> {
    let (from, to) = (result_name(0), result_name(1));
    let edit = edit.without_side_outputs();
    let step = edit.step(&from, &to).map_err(RunError::Edit)?;
    let context = edit_context(progress).with_intermediates();
    match input {
        Content::Picture(picture) => context.insert_picture(&from, Picture::clone(picture)),
        Content::Mesh(mesh) => context.insert_mesh(&from, mesh.clone()),
    }
    let report = step.operation().run(&context).map_err(RunError::Job)?;
    let content = match input {
        Content::Picture(_) => context
            .picture(&to)
            .map(|picture| Content::Picture(Arc::new(picture))),
        Content::Mesh(_) => context.mesh(&to).map(|mesh| Content::Mesh(Arc::new(mesh))),
    };
    Ok((content.map_err(RunError::Job)?, report))
}
