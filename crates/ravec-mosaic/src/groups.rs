//! Near-duplicates: photos that the eye takes for one another.
//!
//! Photos are taken in order. Each joins the nearest of the leaders that came before if that is near enough, or becomes a
//! leader. So all members are near their leader, and no chain of small steps makes one group of a sunset.

use crate::descriptor::{Descriptor, MAX_DEGREE, Weights};
use crate::search::PhotoIndex;
use ravec_progress::{Cancelled, Progress};

/// Largest distance of near-duplicates: the root of the mean squared difference in Oklab. 0.012 is a third of what a
/// change by one 4-bit step of gray makes; copies at other sizes and qualities of JPEG stay below, frames of a burst
/// with a person that moves are above.
pub const NEAR_DUPLICATE: f32 = 0.012;

/// Neighbors that are examined for each photo. Of larger clusters some members may become leaders of their own.
const NEIGHBORS: usize = 24;

/// The group of each photo, numbered from 0 in the order of their leaders; `apart` is how far members may be from their
/// leader.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn near_duplicates(
    descriptors: &[Descriptor],
    apart: f32,
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let weights = Weights {
        degree: MAX_DEGREE,
        detail: 1.0,
    };
    let vectors: Vec<f32> = descriptors
        .iter()
        .flat_map(|descriptor| weights.vector(descriptor))
        .collect();
    if descriptors.is_empty() {
        return Ok(Vec::new());
    }
    let dimensions = vectors.len() / descriptors.len();
    let index = PhotoIndex::new(&vectors, dimensions);
    let near = index.nearest_of_all(&vectors, NEIGHBORS, apart * apart, progress)?;
    let mut groups: Vec<u32> = Vec::with_capacity(descriptors.len());
    let mut leaders: Vec<u32> = Vec::new();
    for (photo, near) in near.iter().enumerate() {
        let leader = near.iter().find(|near| {
            let other = near.photo as usize;
            other < photo && leaders[groups[other] as usize] == near.photo
        });
        let group = if let Some(leader) = leader {
            groups[leader.photo as usize]
        } else {
            leaders.push(photo as u32);
            leaders.len() as u32 - 1
        };
        groups.push(group);
    }
    Ok(groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptor(lightness: f32) -> Descriptor {
        Descriptor {
            coefficients: vec![[lightness, 0.0, 0.0]; 21],
            quarters: [[lightness, 0.0, 0.0]; 4],
        }
    }

    #[test]
    fn photos_join_a_leader_and_no_chain() {
        // 21 equal coefficients: the distance is sqrt(21) times that of one
        let step = 0.9 * NEAR_DUPLICATE / 21.0f32.sqrt();
        let descriptors = [
            descriptor(0.5),
            descriptor(0.5 + step),
            descriptor(0.5 + 2.0 * step),
            descriptor(0.1),
        ];
        let groups = near_duplicates(&descriptors, NEAR_DUPLICATE, &Progress::none()).unwrap();
        assert_eq!(groups, [0, 0, 1, 2]);
        assert_eq!(
            near_duplicates(&[], NEAR_DUPLICATE, &Progress::none()),
            Ok(vec![])
        );
    }
}
