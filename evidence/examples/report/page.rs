//! What a section of the report returns: text, claims, tables, plots, pictures. It knows nothing of files or HTML.

/// One section of the page.
pub struct Section {
    /// What `--only` calls it.
    pub id: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// What stands in it, in order.
    pub items: Vec<Item>,
}

/// A part of a section.
pub enum Item {
    /// A paragraph.
    Text(String),
    /// A statement that was checked, and whether it holds.
    Claim {
        /// The statement, with its figures.
        text: String,
        /// Whether it holds.
        holds: bool,
    },
    /// Rows of figures.
    Table(Table),
    /// Curves.
    Plot(Plot),
    /// Pixels.
    Picture(Picture),
}

/// Rows of figures, which also go to a CSV file.
pub struct Table {
    /// Its file is `SECTION-NAME.csv`.
    pub name: String,
    /// What stands above it.
    pub caption: String,
    /// Headings, with units.
    pub columns: Vec<String>,
    /// As many cells in each row as there are headings.
    pub rows: Vec<Vec<String>>,
}

/// Curves over two axes, which also go to an SVG and a CSV file.
pub struct Plot {
    /// Its files are `SECTION-NAME.svg` and `SECTION-NAME.csv`.
    pub name: String,
    /// What stands in the drawing.
    pub title: String,
    /// What stands above it on the page.
    pub caption: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The curves, in the order of the legend.
    pub series: Vec<Series>,
}

/// An axis.
pub struct Axis {
    /// What is along it, with its unit.
    pub label: String,
    /// Whether it is logarithmic: then values that are not positive are left out.
    pub log: bool,
}

/// A curve.
pub struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Its points, in the order in which they are joined.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub style: Style,
    /// Whether it is this library's: drawn heavier.
    pub ours: bool,
}

/// How a curve is drawn.
#[allow(dead_code)] // all that plots can do, whether or not a section does it
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line without marks.
    Line,
    /// Marks only.
    Points,
    /// A line with marks.
    LineAndPoints,
    /// A broken line without marks.
    Dashed,
}

/// Pixels, which also go to a PNG file.
pub struct Picture {
    /// Its file is `SECTION-NAME.png`.
    pub name: String,
    /// What stands above it.
    pub caption: String,
    /// The file's bytes.
    pub png: Vec<u8>,
}
