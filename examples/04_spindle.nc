(spindle, coolant and outputs: groupstart verify examples/04_spindle.nc -m mill3-spindle)
G21 G90 G17 G64 P0.01
M64 P0                   (vacuum on, at once)
M3 S3000                 (the plan waits until the spindle is at speed)
M8
M67 E0 Q40               (blower at 40 %, with the next motion)
G0 X10 Y10
G1 Z-1 F300
G1 X40 F1200
M62 P1                   (the pen marks from here)
G1 Y30
M63 P1                   (to here)
G1 X10
M7
S1500                    (slower: the plan waits again)
G1 Y10 F600
G0 Z5
M9
M5
M68 E0 Q0
G0 X0 Y0
G0 Z0
M65 P0
M2
