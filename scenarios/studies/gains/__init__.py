"""`convoy paper gains`: stabilising sets, margins, certificates, propagation, lowest rates."""
