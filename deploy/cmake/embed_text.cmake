# Writes a header with a text as a constant: cmake -DOUT=FILE -DNAME=CONSTANT -DSOURCE=FILE -P embed_text.cmake
file(READ ${SOURCE} text)
file(WRITE ${OUT} "inline constexpr char ${NAME}[] = R\"TEXT(\n${text})TEXT\";\n")
