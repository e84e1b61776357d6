"""New meshes for bodies that have deformed, and what is carried over to them."""
