//! What the tests of the binary share: a place to work in and small files to draw.

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin_cmd;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder of its own, gone when dropped.
pub(crate) struct Workplace(TempDir);

impl Workplace {
    pub(crate) fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, contents: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, contents).unwrap();
        path
    }

    /// The names of all files, sorted.
    pub(crate) fn files(&self) -> Vec<String> {
        let names = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> =
            names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// `oblate` with this folder as its own.
    pub(crate) fn oblate(&self, args: &[&str]) -> Command {
        let mut command = cargo_bin_cmd!("oblate");
        command.current_dir(self.0.path()).args(args);
        command
    }

    /// Runs `oblate`, which must succeed; gives standard output and standard error.
    pub(crate) fn run(&self, args: &[&str]) -> [String; 2] {
        let output = self.oblate(args).output().unwrap();
        let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert!(output.status.success(), "oblate {}: {err}", args.join(" "));
        [out, err]
    }

    /// Runs `oblate`, which must refuse with 2; gives what it says.
    pub(crate) fn refusal(&self, args: &[&str]) -> String {
        let output = self.oblate(args).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "oblate {}: {err}", args.join(" "));
        assert!(output.stdout.is_empty());
        err
    }

    /// A cube from −1 to 1.
    pub(crate) fn cube(&self) -> PathBuf {
        self.write(
            "cube.obj",
            "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
             f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n",
        )
    }

    /// A ball of radius 6 in 16³ bytes: 200 in its middle, falling by 25 a voxel.
    pub(crate) fn ball(&self) -> PathBuf {
        let value = |i: usize| {
            let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(|n| n as f64 - 7.5);
            (200.0 - 25.0 * (x * x + y * y + z * z).sqrt()).max(0.0) as u8
        };
        self.write("ball_16x16x16_uint8.raw", (0..16 * 16 * 16).map(value).collect::<Vec<u8>>())
    }
}

/// The pixels of a PNG as 8-bit levels.
pub(crate) fn levels(path: &Path) -> image::RgbaImage {
    image::open(path).unwrap().into_rgba8()
}

/// Mean of the red channel.
pub(crate) fn brightness(path: &Path) -> f64 {
    let picture = levels(path);
    picture.pixels().map(|p| f64::from(p[0])).sum::<f64>() / f64::from(picture.width() * picture.height())
}
