//! The repository itself: its book, its lines, its packages and its dependencies.

mod book;
mod cluster;
mod columns;
mod packages;
mod wall;
