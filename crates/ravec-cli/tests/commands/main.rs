//! The program as a user meets it: what it prints, what it leaves behind, how it ends.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod boolean;
mod brush;
mod compare;
mod complete;
mod demo;
mod device;
mod examples;
mod extremes;
mod frame;
mod hostile;
mod interrupt;
mod library;
mod mesh;
mod mesh_hostile;
mod meshes;
mod mosaic;
mod offset;
mod outputs;
mod overwrites;
mod pictures;
mod planes;
mod program;
mod recipes;
mod scenes;
mod terminal;
mod twocolor;
mod verdicts;
