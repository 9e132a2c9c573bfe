//! Lets the linker accept Python's symbols, which are there only in a Python process. Other than Linux's, linkers have
//! to be told.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
