//! Lets the linker accept Python's symbols, which exist only in a Python process. Linux's linker accepts them anyway.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
