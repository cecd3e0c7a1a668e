//! Two-color pixels.

mod clean;
mod coarse_to_fine;
mod dense;
mod field;
mod fit;
mod line;
mod pixel;
mod split_table;
mod subpixel;
mod sweep;

pub use clean::{CleanParams, NoiseLevel, clean, clean_with, estimate_noise};
pub use dense::{CenteredWindow, WindowParams, map_windows};
pub use field::{FitError, FitMethod, FitParams, TwoColorField};
pub use line::Line;
pub use pixel::TwoColorPixel;
pub use split_table::{MAX_EXACT_SIDE, split_count};
pub use subpixel::refine_line;
