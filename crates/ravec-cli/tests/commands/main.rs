//! The program as a user meets it: what it prints, what it leaves behind, how it ends.

mod compare;
mod frame;
mod program;
mod scenes;
