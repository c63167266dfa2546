//! oblate: point-based and surface-splat rendering.

pub use oblate_engine as engine;
pub use oblate_importers as importers;
pub use oblate_surfels as surfels;
pub use oblate_volumes as volumes;
