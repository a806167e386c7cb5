#version 330 core
// Vertex shader of every mesh. A body is lit here, once per vertex: on software OpenGL the
// fragments are the cost, and a body has fewer vertices than the picture has pixels.
// The ground, which has no vertex colours, is drawn as it is. A textured body (a character) leaves
// two colours for its fragments: light, which its texture is multiplied by, and gloss.
// Before compiling, pyrender replaces each *_LOC and MAX_* name by a number.

layout(location = 0) in vec3 position;
#ifdef NORMAL_LOC
layout(location = NORMAL_LOC) in vec3 normal;
#endif
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord_0;
out vec2 uv;
#endif
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 color_0;
#endif
layout(location = INST_M_LOC) in mat4 inst_m;

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;

#ifdef COLOR_0_LOC
out vec3 lit_color;
#ifdef HAS_BASE_COLOR_TEX
out vec3 gloss_color;
#endif
uniform float floor_m;  // below which nothing is seen

// Browsers light bodies by the same lines, from here on:
struct DirectionalLight { vec3 color; float intensity; vec3 direction; };
struct Material {
    vec4 base_color_factor;
    float roughness_factor;
#ifdef HAS_BASE_COLOR_TEX
    sampler2D base_color_texture;
#endif
};
uniform Material material;
uniform DirectionalLight directional_lights[MAX_DIRECTIONAL_LIGHTS];
uniform int n_directional_lights;
uniform vec3 ambient_light;
uniform vec3 cam_pos;

const vec3 GROUND_BOUNCE = vec3(0.72, 0.68, 0.65);
const vec3 SKY = vec3(1.05, 1.10, 1.20);
const float WRAP = 0.20;       // light reaches a little beyond the terminator, as on skin
const float SPECULAR = 0.06;
const float POLISHED = 96.0;   // gloss of roughness 0
const float MATT = 8.0;        // and of roughness 1
const float EDGE = 0.10;       // how much brighter a body is where it turns away
const float EXPOSURE = 1.12;
const float ROLL_OFF = 0.22;

vec3 shade(vec3 point, vec3 n, vec3 base) {
    vec3 to_eye = normalize(cam_pos - point);
    vec3 color = base * ambient_light * mix(GROUND_BOUNCE, SKY, n.y * 0.5 + 0.5);
    float gloss = mix(POLISHED, MATT, material.roughness_factor);
    for (int i = 0; i < n_directional_lights; i++) {
        vec3 to_light = -directional_lights[i].direction;
        float diffuse = max((dot(n, to_light) + WRAP) / (1.0 + WRAP), 0.0);
        vec3 halfway = normalize(to_light + to_eye);
        float specular = SPECULAR * diffuse * pow(max(dot(n, halfway), 0.0), gloss);
        color += (base * diffuse + specular)
            * directional_lights[i].color * (directional_lights[i].intensity / 3.14159265);
    }
    float edge = 1.0 - max(dot(n, to_eye), 0.0);
    return color + base * EDGE * edge * edge * edge * edge;
}

// Roll off the highlights, then to display colours (gamma 2).
vec3 to_display(vec3 color) {
    return sqrt(clamp(EXPOSURE * color / (1.0 + ROLL_OFF * color), 0.0, 1.0));
}
// As far as here.
#endif

void main() {
    vec4 world = M * inst_m * vec4(position, 1.0);
    gl_Position = P * (V * world);
#ifdef TEXCOORD_0_LOC
    uv = texcoord_0;
#endif
#ifdef COLOR_0_LOC
    vec3 base = material.base_color_factor.rgb * color_0.rgb;
    vec3 n = vec3(0.0, 1.0, 0.0);
#ifdef NORMAL_LOC
    n = normalize(mat3(M) * mat3(inst_m) * normal);
#endif
    gl_ClipDistance[0] = world.y - floor_m;
#ifdef HAS_BASE_COLOR_TEX
    gloss_color = shade(world.xyz, n, vec3(0.0));
    lit_color = shade(world.xyz, n, base) - gloss_color;
#endif
#ifndef HAS_BASE_COLOR_TEX
    lit_color = to_display(shade(world.xyz, n, base));
#endif
#endif
}
