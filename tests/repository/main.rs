//! The repository itself: its book, its lines and its dependencies.

mod book;
mod columns;
mod wall;
