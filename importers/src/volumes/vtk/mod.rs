//! VTK's files: images, rectilinear and structured grids in XML (`.vti`, `.vtr`, `.vts`) and of the legacy format (`.vtk`).
//!
//! Source: *VTK File Formats* (docs.vtk.org). Read are ImageData (legacy `STRUCTURED_POINTS`), RectilinearGrid, which is a regular volume where
//! steps along each axis are equal, and StructuredGrid; other datasets are refused by name. Of the point data the array is taken
//! that XML's `Scalars` names, else the first of one component; without one among the point data the same of the cell
//! data, whose samples are the cells' centres, half a step from the points.

mod array;
pub(crate) mod grid;
pub mod legacy;
pub mod xml;
