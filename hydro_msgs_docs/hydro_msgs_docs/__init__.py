"""Topics, bus and bag contract. Arguments are named as in `hydro_model`."""
