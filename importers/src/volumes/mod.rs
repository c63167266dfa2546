//! Files to volumes.

pub mod dicom;
pub(crate) mod dicom_data_set;
mod dicom_pixels;
pub(crate) mod frame;
pub mod meta_image;
pub mod nifti;
pub mod nrrd;
pub mod plot3d;
pub mod raw;
pub mod slices;
pub mod tiff;
mod tiff_pages;
pub(crate) mod voxels;
pub mod vtk;
mod xml;
