"""Few columns that contain every entity: exactly with a proof, by exchange without one, and the linear relaxation."""
