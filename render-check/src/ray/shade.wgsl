// Gradients, Blinn and Phong. Twin of shade.rs.

const FAINT: f32 = 0.01;

fn light_at(leaf: Leaf, ray: Ray, at: vec3<f32>, level: f32) -> vec2<f32> {
    let h = voxel_of(leaf);
    let difference = vec3(
        value_of(leaf, at + vec3(h, 0.0, 0.0), level) - value_of(leaf, at - vec3(h, 0.0, 0.0), level),
        value_of(leaf, at + vec3(0.0, h, 0.0), level) - value_of(leaf, at - vec3(0.0, h, 0.0), level),
        value_of(leaf, at + vec3(0.0, 0.0, h), level) - value_of(leaf, at - vec3(0.0, 0.0, h), level),
    );
    let spacing = frame.spacing;
    let finest = min(min(spacing.x, spacing.y), spacing.z);
    let gradient = difference / (2.0 * h) * (finest / spacing);
    let square = dot(gradient, gradient);
    let trust = square / (square + FAINT * FAINT);
    let normal = gradient / sqrt(max(square, 1e-20));
    let towards = select(-ray.direction, frame.light, dot(frame.light, frame.light) > 0.0);
    let between_them = towards - ray.direction;
    let half_way = between_them / sqrt(max(dot(between_them, between_them), 1e-20));
    let diffuse = abs(dot(normal, towards));
    let highlight = pow(max(abs(dot(normal, half_way)), 1e-6), frame.shininess);
    let factor = frame.ambient + frame.diffuse * diffuse;
    return vec2(1.0 + (factor - 1.0) * trust, frame.specular * highlight * trust);
}
