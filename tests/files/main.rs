//! Trees in files: what comes back, what is refused, and what a file made to deceive can not do.

mod damage;
mod points;
mod rays;
mod support;
