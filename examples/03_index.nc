(Six flats round a bar: an indexer on a CY545 turns it between the cuts.)
(The indexer cannot be interpolated, so every A stands in a block of its own.)
G21 G90 G17 G64 P0.01
G0 Z5
G0 X10 Y10
M3 S8000
o100 repeat [6]
  G0 X10 Y10
  G0 Z1
  G1 Z-0.5 F200
  G1 X40 F900
  G1 Y14
  G1 X10
  G0 Z5
  G91
  G0 A60
  G90
o100 endrepeat
M5
G0 X0 Y0
G0 A0
M2
