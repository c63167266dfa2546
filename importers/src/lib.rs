//! Files to meshes and volumes.
