"""The search: poses are judged, columns found, covers chosen, settings settled, stage by stage.

A setting found satisfies every constraint of its request; where none is found, the error names
constraint, entity and amount. The same request and seed give the same bits, with or without
interruption.

Names are imported from their modules, so that a light one does not wait for the compiler.
"""
