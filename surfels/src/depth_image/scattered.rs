//! Values between scattered places of a picture.

use glam::DVec2;
use rayon::prelude::*;
use spade::handles::FixedVertexHandle;
use spade::{
    DelaunayTriangulation, HasPosition, HierarchyHintGenerator, InsertionError, Point2, Triangulation,
};

/// Places, triangulated (Delaunay).
pub(super) struct Scattered {
    triangulation: DelaunayTriangulation<Place, (), (), (), HierarchyHintGenerator<f64>>,
}

/// A place and its number.
#[derive(Clone, Copy)]
struct Place {
    at: Point2<f64>,
    number: u32,
}

impl HasPosition for Place {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

impl Scattered {
    /// Of places in pixels; of two at the same place one counts.
    ///
    /// # Errors
    /// When a place is not finite or too large.
    pub(super) fn new(places: impl Iterator<Item = DVec2>) -> Result<Self, InsertionError> {
        let place =
            |(number, at): (usize, DVec2)| Place { at: Point2::new(at.x, at.y), number: number as u32 };
        let triangulation = DelaunayTriangulation::bulk_load_stable(places.enumerate().map(place).collect())?;
        Ok(Self { triangulation })
    }

    /// What `of` makes, for each query, of the numbers of its natural neighbours and their shares, which add up to 1 (Sibson, *A Brief Description of
    /// Natural Neighbour Interpolation*, 1981). `None` outside the places' convex hull.
    pub(super) fn at_each<T: Send>(
        &self,
        queries: &[DVec2],
        of: impl Fn(&[(usize, f64)]) -> T + Sync,
    ) -> Vec<Option<T>> {
        let chunk = |queries: &[DVec2]| {
            let neighbors = self.triangulation.natural_neighbor();
            let mut found: Vec<(FixedVertexHandle, f64)> = Vec::new();
            let mut shares: Vec<(usize, f64)> = Vec::new();
            let one = |query: &DVec2| {
                neighbors.get_weights(Point2::new(query.x, query.y), &mut found);
                shares.clear();
                let number = |vertex| self.triangulation.vertex(vertex).data().number as usize;
                shares.extend(found.iter().map(|(vertex, share)| (number(*vertex), *share)));
                // Degenerate cells have areas that are none.
                let is_right = !shares.is_empty() && shares.iter().all(|(_, share)| share.is_finite());
                is_right.then(|| of(&shares))
            };
            queries.iter().map(one).collect::<Vec<_>>()
        };
        queries.par_chunks(1 << 10).flat_map_iter(chunk).collect()
    }

    /// The number of the place that is nearest to one; `None` without any.
    pub(super) fn nearest(&self, to: DVec2) -> Option<usize> {
        let found = self.triangulation.nearest_neighbor(Point2::new(to.x, to.y))?;
        Some(found.data().number as usize)
    }
}
