//! The repository itself: its book, its lines, its packages, its dependencies, and the keys of the files it writes.

mod absent;
mod book;
mod cluster;
mod columns;
mod packages;
mod wall;
