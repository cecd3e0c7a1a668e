//! Quantization of a JPEG file, which says how strong the damage of its compression is and where it lies.
//!
//! Source: ITU-T T.81, sections B.2.2 (frames) and B.2.4.1 (quantization tables).

use image::metadata::Orientation;

/// Side of a block.
const SIDE: usize = 8;

/// Quantization of the luma of a picture that was compressed in blocks of 8 × 8 pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quantization {
    /// Steps of the cosine coefficients in 8-bit units, `[vertical][horizontal]` frequency, 1 to 65535.
    pub luma_steps: [[u16; SIDE]; SIDE],
    /// First column and row at which a block begins, each below 8.
    pub grid: [usize; 2],
}

impl Quantization {
    /// Reads the tables before the first scan of a JPEG file. Nothing if the first component is not luma in blocks of
    /// 8 × 8 pixels, or the headers are damaged.
    pub(crate) fn of_jpeg(data: &[u8]) -> Option<Self> {
        let mut tables = [None; 4];
        let mut luma_table = None;
        let mut rest = data.strip_prefix(&[0xff, 0xd8])?;
        loop {
            let (marker, segment, after) = segment(rest)?;
            rest = after;
            match marker {
                0xdb => read_tables(segment, &mut tables)?,
                0xc0..=0xc2 => luma_table = Some(luma_table_of(segment)?),
                // the first scan
                0xda => break,
                _ => {}
            }
        }
        Some(Self {
            luma_steps: (*tables.get(luma_table?)?)?,
            grid: [0, 0],
        })
    }

    /// The same quantization of the picture turned upright, which has `width` × `height` pixels before that.
    pub(crate) fn upright(self, orientation: Orientation, width: usize, height: usize) -> Self {
        // an axis that is read backwards ends with the first block
        let (from_right, from_bottom) = (width % SIDE, height % SIDE);
        let (grid, is_transposed) = match orientation {
            Orientation::NoTransforms => ([0, 0], false),
            Orientation::FlipHorizontal => ([from_right, 0], false),
            Orientation::Rotate180 => ([from_right, from_bottom], false),
            Orientation::FlipVertical => ([0, from_bottom], false),
            Orientation::Rotate90FlipH => ([0, 0], true),
            Orientation::Rotate90 => ([from_bottom, 0], true),
            Orientation::Rotate270FlipH => ([from_bottom, from_right], true),
            Orientation::Rotate270 => ([0, from_right], true),
        };
        let steps = self.luma_steps;
        Self {
            luma_steps: if is_transposed {
                std::array::from_fn(|v| std::array::from_fn(|u| steps[u][v]))
            } else {
                steps
            },
            grid,
        }
    }
}

/// The next marker, what its segment holds, and the rest of the file.
fn segment(data: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let data = data.strip_prefix(&[0xff])?;
    // any number of fill bytes
    let fill = data.iter().take_while(|&&byte| byte == 0xff).count();
    let (&marker, data) = data[fill..].split_first()?;
    let (&length, _) = data.split_first_chunk::<2>()?;
    let length = usize::from(u16::from_be_bytes(length));
    let segment = data.get(2..length)?;
    Some((marker, segment, &data[length..]))
}

/// Reads the tables of a DQT segment.
fn read_tables(mut segment: &[u8], tables: &mut [Option<[[u16; SIDE]; SIDE]>; 4]) -> Option<()> {
    while let Some((&kind, values)) = segment.split_first() {
        let (precision, target) = (kind >> 4, usize::from(kind & 15));
        let bytes = if precision == 0 { 1 } else { 2 };
        let (values, rest) = values.split_at_checked(SIDE * SIDE * bytes)?;
        let mut steps = [[0u16; SIDE]; SIDE];
        for (value, [v, u]) in values.chunks_exact(bytes).zip(zigzag()) {
            let step = value
                .iter()
                .fold(0, |step, &byte| step << 8 | u16::from(byte));
            steps[v][u] = step.max(1);
        }
        *tables.get_mut(target)? = Some(steps);
        segment = rest;
    }
    Some(())
}

/// The number of the table of the first component, if this has the full resolution of the picture.
fn luma_table_of(frame: &[u8]) -> Option<usize> {
    let (header, components) = frame.split_at_checked(6)?;
    if header[0] != 8 {
        return None;
    }
    let sampling = |component: &[u8]| [component[1] >> 4, component[1] & 15];
    let components: Vec<&[u8]> = components.chunks_exact(3).collect();
    let first = sampling(components.first()?);
    let is_full = |component: &&&[u8]| {
        let [horizontal, vertical] = sampling(component);
        horizontal <= first[0] && vertical <= first[1]
    };
    let all_within = components.iter().filter(is_full).count() == components.len();
    all_within.then(|| usize::from(components[0][2]))
}

/// The frequencies in the order of files, `[vertical, horizontal]`.
fn zigzag() -> impl Iterator<Item = [usize; 2]> {
    (0..2 * SIDE - 1).flat_map(|sum| {
        let least = sum.saturating_sub(SIDE - 1);
        let most = sum.min(SIDE - 1);
        (least..=most).map(move |i| {
            // odd diagonals are walked downwards
            if sum % 2 == 1 {
                [i, sum - i]
            } else {
                [sum - i, i]
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orient::upright;
    use ravec_raster::{AnyImage, Image, Size, Srgb};

    #[test]
    fn frequencies_are_in_the_order_of_the_standard() {
        let order: Vec<_> = zigzag().collect();
        assert_eq!(order.len(), 64);
        assert_eq!(
            order[..7],
            [[0, 0], [0, 1], [1, 0], [2, 0], [1, 1], [0, 2], [0, 3]]
        );
        assert_eq!(order[62..], [[7, 6], [7, 7]]);
    }

    fn jpeg(tables: &[u8], frame: &[u8]) -> Vec<u8> {
        let mut data = vec![0xff, 0xd8];
        for (marker, segment) in [(0xdb, tables), (0xc0, frame), (0xda, &[])] {
            data.extend([0xff, 0xff, marker]);
            data.extend((segment.len() as u16 + 2).to_be_bytes());
            data.extend(segment);
        }
        data
    }

    const COLOR: [u8; 15] = [8, 0, 9, 0, 9, 3, 1, 0x22, 1, 2, 0x11, 0, 3, 0x11, 0];

    #[test]
    fn the_table_of_the_first_component_is_read_in_8_and_16_bit() {
        let mut tables = vec![0];
        tables.extend([99; 64]);
        tables.push(0x11);
        tables.extend((0..64u16).flat_map(|i| (300 + i).to_be_bytes()));
        let found = Quantization::of_jpeg(&jpeg(&tables, &COLOR)).unwrap();
        assert_eq!(found.luma_steps[0][..3], [300, 301, 305]);
        assert_eq!(found.luma_steps[1][0], 302);
        assert_eq!(found.luma_steps[7][7], 363);
    }

    #[test]
    fn damaged_and_unusual_headers_give_nothing() {
        let mut tables = vec![1];
        tables.extend([7; 64]);
        let data = jpeg(&tables, &COLOR);
        assert!(Quantization::of_jpeg(&data).is_some());
        for length in 0..data.len() {
            assert_eq!(Quantization::of_jpeg(&data[..length]), None);
        }
        let mut frame = COLOR;
        frame[7] = 0x11;
        frame[10] = 0x22;
        assert_eq!(Quantization::of_jpeg(&jpeg(&tables, &frame)), None);
        // a table that the file does not define
        frame = COLOR;
        frame[8] = 9;
        assert_eq!(Quantization::of_jpeg(&jpeg(&tables, &frame)), None);
    }

    #[test]
    fn the_grid_turns_with_the_picture() {
        // blocks are numbered by their columns and rows
        let (width, height) = (21, 12);
        let size = Size::new(width, height).unwrap();
        let image = Image::from_fn(size, |col, row| {
            Srgb([(col / SIDE) as u8, (row / SIDE) as u8, 0])
        });
        let mut steps = [[1; SIDE]; SIDE];
        steps[0][3] = 9;
        let stored = Quantization {
            luma_steps: steps,
            grid: [0, 0],
        };
        for exif in 1..=8 {
            let orientation = Orientation::from_exif(exif).unwrap();
            let AnyImage::Srgb8(turned) = upright(image.clone().into(), orientation) else {
                panic!("another type");
            };
            let found = stored.upright(orientation, width, height);
            for x in 1..turned.width() {
                let begins = turned[(x, 0)] != turned[(x - 1, 0)];
                assert_eq!(begins, x % SIDE == found.grid[0], "{exif} {x}");
            }
            for y in 1..turned.height() {
                let begins = turned[(0, y)] != turned[(0, y - 1)];
                assert_eq!(begins, y % SIDE == found.grid[1], "{exif} {y}");
            }
            let [v, u] = if exif >= 5 { [3, 0] } else { [0, 3] };
            assert_eq!(found.luma_steps[v][u], 9);
        }
    }
}
