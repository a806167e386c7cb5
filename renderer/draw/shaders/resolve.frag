#version 330 core
// Fragment shader that lays the supersampled body over the picture: at the middle of 2 x 2 samples
// the linear filter gives their mean, whose alpha is the share of the pixel that is covered.

uniform sampler2D samples;
in vec2 uv;
out vec4 frag_color;

void main() {
    frag_color = texture(samples, uv);
}
