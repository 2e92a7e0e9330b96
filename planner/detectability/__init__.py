"""What an image needs beside an unhidden edge, so that the edge can be found in it: corners, and room around."""
