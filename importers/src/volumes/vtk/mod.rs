//! VTK's files: images and rectilinear grids in XML (`.vti`, `.vtr`) and of the legacy format (`.vtk`).
//!
//! Source: *VTK File Formats* (docs.vtk.org). Read are ImageData (legacy `STRUCTURED_POINTS`) and, with equal steps
//! along each axis, RectilinearGrid; other datasets are refused by name. Of the point data the array is taken
//! that XML's `Scalars` names, else the first of one component; without one among the point data the same of the cell
//! data, whose samples are the cells' centres, half a step from the points.

mod array;
mod grid;
pub mod legacy;
pub mod xml;
