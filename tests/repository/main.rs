//! The repository itself: its book, its lines and its dependencies.

mod book;
mod cluster;
mod columns;
mod wall;
