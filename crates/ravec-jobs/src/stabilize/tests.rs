//! `stabilize` on clips whose motion is known.
