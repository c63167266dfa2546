//! Buffers that are kept from frame to frame.

use rayon::prelude::*;

/// Values that a thread adds in one go.
const VALUES_A_TASK: usize = 1 << 14;

/// Makes a buffer at least so long. All threads write: to touch memory first is what takes long.
pub(crate) fn grow<T: Send>(buffer: &mut Vec<T>, len: usize, value: impl Fn() -> T + Sync) {
    let missing = len.saturating_sub(buffer.len());
    if missing > 0 {
        let values = (0..missing).into_par_iter().with_min_len(VALUES_A_TASK);
        buffer.par_extend(values.map(|_| value()));
    }
}
