//! The finished picture and what was measured at its pixels.

/// A picture of `width * height` pixels, rows from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear Rec. 709, premultiplied, and alpha.
    pub color: Vec<[f32; 4]>,
    /// z of the first surface layer, however little it covers; infinity where there is none.
    pub depth: Vec<f32>,
    /// Mean z of what is seen, weighted by its contribution, the background left out; infinity where
    /// nothing is seen.
    pub expected_depth: Vec<f32>,
    /// Unit normal of the first surface layer in the world, on the side that is seen; zero where there is none.
    pub normal: Vec<[f32; 3]>,
    /// Id of the front-most surface splat, counted through the scene's clouds; [`Frame::NO_ID`] where
    /// there is none.
    pub id: Vec<u32>,
}

impl Frame {
    /// The id of a pixel without a surface.
    pub const NO_ID: u32 = u32::MAX;

    /// An empty picture: transparent, no surface.
    pub fn new(width: usize, height: usize) -> Self {
        let count = width * height;
        Self {
            width,
            height,
            color: vec![[0.0; 4]; count],
            depth: vec![f32::INFINITY; count],
            expected_depth: vec![f32::INFINITY; count],
            normal: vec![[0.0; 3]; count],
            id: vec![Self::NO_ID; count],
        }
    }
}
