//! XML of volume formats, parsed only if it cannot come to much more memory than the file has bytes.

use roxmltree::Document;

/// Bytes that a `<` comes to at most: of an element and the text behind it.
const PER_TAG: usize = 160;

/// Bytes that an attribute comes to.
const PER_ATTRIBUTE: usize = 80;

/// What any document may come to.
const LEAST_ROOM: usize = 1 << 20;

/// Attributes of an element: each is compared with all others.
const MOST_ATTRIBUTES: usize = 256;

/// The document that `text` writes, which is all or a part of a file of `length` bytes; or the line and what is wrong.
pub(super) fn document(text: &str, length: usize) -> Result<Document<'_>, (usize, String)> {
    let count = |part: &str, sign: u8| part.bytes().filter(|&byte| byte == sign).count();
    let size = PER_TAG * count(text, b'<') + PER_ATTRIBUTE * count(text, b'=');
    if size > LEAST_ROOM + 2 * length {
        return Err((1, format!("XML: its tags come to {size} bytes, far more than a file of {length}")));
    }
    let mut line = 1;
    for tag in text.split('<') {
        if count(tag, b'=') > MOST_ATTRIBUTES {
            return Err((line, format!("XML: an element of more than {MOST_ATTRIBUTES} attributes")));
        }
        line += count(tag, b'\n');
    }
    Document::parse(text).map_err(|error| (error.pos().row as usize, format!("XML: {error}")))
}
