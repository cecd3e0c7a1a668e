//! Answers under the hand: small computations about an edit while the hand moves.
//!
//! One thread a document, apart from the one that computes results. Each kind of question has one place: a newer question takes the
//! place of the one that waits, and the last answer stays until a newer one is there. What a kind of question prepares, such as an
//! index of a picture, is kept as long as the questions are about the same picture.
//!
//! Answers are computed on threads of their own: on those of the results, they would wait for the end of a result.

use crate::analyses::Analyses;
use crate::engine::lock;
use crate::tracking::Tracking;
use crate::worker::Worker;
use ravec::progress::Progress;
use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Condvar, LazyLock, Mutex, PoisonError};

/// An answer of any type.
type Answer = Arc<dyn Any + Send + Sync>;

/// The threads that answers are computed on, of all documents; those of the results where there are none.
static POOL: LazyLock<Option<rayon::ThreadPool>> = LazyLock::new(|| {
    let threads = rayon::ThreadPoolBuilder::new().thread_name(|index| format!("answers {index}"));
    threads.build().ok()
});

/// A question.
type Job = Box<dyn FnOnce(&mut Memory, &Progress) -> Option<Answer> + Send>;

/// Numbers of the last question of each kind and of the last one with an answer; zeros where there is none.
pub(crate) type QuestionCounts = BTreeMap<&'static str, [u64; 2]>;

/// Prepared data, such as indices of pictures, by the kind of question.
#[derive(Default)]
pub(crate) struct Memory {
    kept: HashMap<&'static str, (Arc<str>, Box<dyn Any + Send>)>,
}

impl Memory {
    /// The value that was made for this key, or a new one.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn keep<T: Any + Send, E>(
        &mut self,
        kind: &'static str,
        key: &Arc<str>,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<&mut T, E> {
        let known = self.kept.remove(kind).filter(|(of, _)| of == key);
        let value = match known.map(|(_, value)| value.downcast::<T>()) {
            Some(Ok(value)) => value,
            _ => Box::new(make()?),
        };
        let place = self.kept.entry(kind).insert_entry((key.clone(), value));
        let value = place.into_mut().1.downcast_mut::<T>();
        Ok(value.expect("the type that was put in one line above"))
    }
}

#[derive(Default)]
struct State {
    waiting: Vec<(&'static str, u64, Job)>,
    /// Number of the last question.
    asked: u64,
    counts: QuestionCounts,
    running: Option<(&'static str, Progress)>,
    answers: HashMap<&'static str, Answer>,
    quits: bool,
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    repaint: Arc<dyn Fn() + Send + Sync>,
}

/// Answers questions about one document.
pub(crate) struct Assistant {
    /// Measures a plane, which takes long.
    pub tracking: Arc<Tracking>,
    /// Finds what edits of a shot need.
    pub analyses: Analyses,
    shared: Arc<Shared>,
    _worker: Worker,
}

impl Assistant {
    /// An idle assistant. `repaint` is called, from another thread, when there is an answer.
    pub fn new(repaint: impl Fn() + Send + Sync + 'static) -> Self {
        let repaint: Arc<dyn Fn() + Send + Sync> = Arc::new(repaint);
        let tracking = Arc::new(Tracking::new(repaint.clone()));
        let analyses = Analyses::new(tracking.clone(), repaint.clone());
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wake: Condvar::new(),
            repaint,
        });
        let own = shared.clone();
        Self {
            tracking,
            analyses,
            shared,
            _worker: Worker::start("assistant", move || work(&own)),
        }
    }

    /// Asks a question in place of the one of this kind that waits. A job without an answer leaves the last one.
    pub fn ask<A: Any + Send + Sync>(
        &self,
        kind: &'static str,
        job: impl FnOnce(&mut Memory, &Progress) -> Option<A> + Send + 'static,
    ) {
        let job: Job = Box::new(move |memory, progress| {
            job(memory, progress).map(|answer| Arc::new(answer) as Answer)
        });
        let mut state = lock(&self.shared.state);
        state.asked += 1;
        let number = state.asked;
        state.counts.entry(kind).or_default()[0] = number;
        match state.waiting.iter_mut().find(|(other, ..)| *other == kind) {
            Some(place) => (place.1, place.2) = (number, job),
            None => state.waiting.push((kind, number, job)),
        }
        self.shared.wake.notify_all();
    }

    /// The last answer of a kind.
    pub fn answer<A: Any + Send + Sync>(&self, kind: &'static str) -> Option<Arc<A>> {
        let state = lock(&self.shared.state);
        state.answers.get(kind)?.clone().downcast().ok()
    }

    /// True while a question of this kind waits or is worked on.
    pub fn is_asked(&self, kind: &'static str) -> bool {
        let state = lock(&self.shared.state);
        let running = state
            .running
            .as_ref()
            .is_some_and(|running| running.0 == kind);
        running || state.waiting.iter().any(|(other, ..)| *other == kind)
    }

    /// Numbers of questions and answers.
    pub fn counts(&self) -> QuestionCounts {
        lock(&self.shared.state).counts.clone()
    }

    /// True while any question is open.
    pub fn is_busy(&self) -> bool {
        let state = lock(&self.shared.state);
        state.running.is_some()
            || !state.waiting.is_empty()
            || self.tracking.is_busy()
            || self.analyses.is_busy()
    }
}

impl Drop for Assistant {
    fn drop(&mut self) {
        let mut state = lock(&self.shared.state);
        state.quits = true;
        if let Some((_, progress)) = &state.running {
            progress.cancel();
        }
        self.shared.wake.notify_all();
    }
}

fn work(shared: &Shared) {
    let mut memory = Memory::default();
    loop {
        let (kind, number, job, progress) = {
            let mut state = lock(&shared.state);
            while state.waiting.is_empty() && !state.quits {
                let waited = shared.wake.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
            }
            if state.quits {
                return;
            }
            let (kind, number, job) = state.waiting.remove(0);
            let progress = Progress::new(|_| {});
            state.running = Some((kind, progress.clone()));
            (kind, number, job, progress)
        };
        let answer = match &*POOL {
            Some(pool) => pool.install(|| job(&mut memory, &progress)),
            None => job(&mut memory, &progress),
        };
        let mut state = lock(&shared.state);
        state.running = None;
        if let Some(answer) = answer
            && !progress.is_cancelled()
        {
            state.answers.insert(kind, answer);
            state.counts.entry(kind).or_default()[1] = number;
        }
        drop(state);
        (shared.repaint)();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn wait(assistant: &Assistant) {
        while assistant.is_busy() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn the_last_question_of_a_kind_is_answered_and_its_preparation_kept() {
        let assistant = Assistant::new(|| {});
        let key: Arc<str> = "a".into();
        for number in 0..20 {
            let key = key.clone();
            assistant.ask("sum", move |memory, _| {
                let base = memory
                    .keep("sum", &key, || Ok::<_, ()>(1000 + number))
                    .ok()?;
                Some(*base + number)
            });
        }
        wait(&assistant);
        let answer = *assistant.answer::<i32>("sum").unwrap();
        // prepared by the first that was run, asked last by 19
        assert!((1019..=1038).contains(&answer), "{answer}");
        assistant.ask("sum", move |memory, _| {
            let base = memory.keep("sum", &"b".into(), || Ok::<_, ()>(1)).ok()?;
            Some(*base)
        });
        wait(&assistant);
        assert_eq!(*assistant.answer::<i32>("sum").unwrap(), 1);
        assert!(assistant.answer::<i32>("other").is_none());
    }
}
