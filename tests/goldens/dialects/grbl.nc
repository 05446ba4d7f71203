$H
G21 G90 F100
(nested (comments) end with the outer sign)
G1 X1*63
M300 S200
G1 X2 Q7
G53
G0 G28 X0
G50 G69 G15
M8
G0 X3
M9
%
G0 X4
M30
