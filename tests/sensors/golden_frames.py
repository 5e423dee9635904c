"""Frames of commercial gyros that nobody here made, and what public pages say they mean; where a maker gives none, one
worked out by hand from the maker's table, its sums on paper.

(protocol, frames in hex or as text, values in the unit of the page, source); the counter of Xsens and of the IIM-46234
is the clock that they send beside it.
"""

XSENS = "Scottapotamas/xsens-mti, golden packets of an MTi-300"
VN_BINARY = "VectorNav VN-100 user manual, example of a binary output message"
CANBOAT = "canboat/canboat, samples of database/pgns"

SERIAL = [
    ("vn100", "FA01080093502E42833EF13F48B504BB9288",
     {"yaw": 43.578686, "pitch": 1.884720, "roll": -0.002025}, VN_BINARY),
    ("vn100-ascii", b"$VNYMR,-165.981,-037.301,+001.245,+00.2901,+00.0720,+00.7482,-05.966,-00.150,-07.836,"
     b"+00.001373,-00.001533,-00.001054*68\r\n",
     {"yaw": -165.981, "acc_z": -7.836, "rate_x": 0.001373, "rate_y": -0.001533, "rate_z": -0.001054}, "a ROS driver"),
    ("vn100-ascii", b"$VNYMR,-078.104,+005.642,+023.096,+00.0125,+00.1252,-00.1042,+00.878,-03.762,-08.854,"
     b"-00.010387,-00.028062,-00.061305*68\r\n", {"mag_y": 0.1252, "rate_z": -0.061305}, "a ROS driver"),
    ("vn100-ascii", b"$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,-01.258,-00.100,-09.701,"
     b"-00.000018,+00.001122,-00.000551*69\r\n", {"roll": 0.715, "rate_y": 0.001122}, "VectorNav programming library"),
    ("xsens",
     "FAFF3692" "102002918D" "10600401363FA6" "2010103F35E0423F31CD15BD9F49DBBDA938CF" "40200CBD635A90411D08D43E5FAA50"
     "40100CB91168003CC901003A0F7D00" "40300CBC3B29803C35FC003CA46E00" "80200C3CAEA241BB56D800BAD5AC01"
     "8030103F80000037DF8801B6898000B608C000"
     "C0200CBEFBFBF23F33C485BFA0A2C1"
     "08100442168000" "3010040001" "86E1"
     "E0200400400003",
     {"rate_x": 0.02131760, "rate_y": -0.00327826, "rate_z": -0.00163019, "acc_y": 9.81465530, "temp": 37.625,
      "pressure": 100065, "counter": 0x01363FA6}, XSENS),
    ("xsens", "FAFF3626" "1020024682" "1060040" "1C4FC3E" "2010103F71CE6CBEA56BCF3C613BD8BD691D25"
     "E0200400400003" "12",
     {"q_w": 0.94455600, "q_z": -0.05691256, "counter": 0x01C4FC3E, "status": 0x400003}, XSENS),
    ("xsens", "FAFF361A" "102002AA4E" "802212" "00479AD20000" "006D5FBF0000" "FF0A3905FFFF",
     {"rate_x": 0.0010926020331680775 * 2**32, "rate_y": 0.0016689149197191 * 2**32,
      "rate_z": -0.0037502634804695845 * 2**32, "counter": 43598}, "einride/xsens-go, testdata 3: counts of FP16.32"),
    ("dmu11", "55AA0001" "3F800000" + "00000000" * 6 + "41C80000" + "00000000" * 6 + "000000000000" "290D",
     {"counter": 1, "rate_x": 1.0, "rate_y": 0.0, "temp": 25.0}, "by hand from DMU11-00-0100-132"),
    ("hg4930", "0E01" "0100FFFF0000" "000000000100" "0000" "1980" "2881",
     {"rate_x": 1, "rate_y": -1, "acc_z": 1, "temp": 25}, "by hand from the manual's table"),
    ("iim46234", "23232EAB0005" + "0000000000001388" + "00000000000000003F800000" "0000000000000000BF800000"
     "41C80000" "0452" "0D0A",
     {"counter": 5000, "acc_z": 1.0, "rate_z": -1.0, "temp": 25.0}, "by hand from the maker's driver"),
]  # fmt: skip

CAN = [
    ("nmea2000", 127251, "001a8effff2702ff", {"rate_z": -0.00091119}, CANBOAT),
    ("nmea2000", 127251, "008e2b0000ff7ffd", {"rate_z": 0.00034844}, CANBOAT),
    ("nmea2000", 127251, "00b5fdfeff82aac0", {"rate_z": -0.00206634}, CANBOAT),
    ("furuno", 130842, "3f9ffeffffff0f000000e5ffffff00a600000036000000daffffff0000",
     {"rate_x": 0.00290, "rate_y": 0.00094, "rate_z": -0.00066}, CANBOAT),
    ("furuno", 130842, "3f9f59ffffff270000003f00000000f8fffffff70200000ee1ffff0000",
     {"rate_x": -0.00014, "rate_y": 0.01325, "rate_z": -0.13827}, CANBOAT),
    ("j1939", 61482, "807d007d807dffff", {"rate_y": 0.01745329, "rate_x": 0.0}, "by hand: 32128 / 128 - 250"),
]  # fmt: skip

BOSCH = [
    (0x174, "D08700005B61", {"rate_z": 10.0, "acc_y": -0.99999}),
    (0x178, "000000000080", {"rate_x": -163.84, "acc_x": -0.000027}),
    (0x17C, "FFFF0000A69E", {"rate_y": 163.835, "acc_z": 1.00006}),
]
"""By hand from Bosch Motorsport: identifiers and bytes from the page of the MM7.10; steps of 0.005 °/s and 0.000127465
g from -163.84 °/s and -4.1768 g on from the MM5.10's table in the manual of the ABS M5 Kit. (Identifier, bytes 0 to 5
in hex, values in °/s and g); 0x87D0 = 34768 = (10 + 163.84) / 0.005."""
